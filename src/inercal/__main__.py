"""Entry point of the `inercal` program and of `python -m inercal`.

`main` prepares the process and then loads the verbs. Worker processes import this module, but they
do not need the verbs.
"""

import sys

from inercal.basics.process_settings import prepare_process


def main() -> None:
    """Run the program; an input error is one line on standard error and exit status 2."""
    try:
        prepare_process()
        from inercal.cli.app import main as run_verb
    except KeyboardInterrupt:  # loading the verbs takes a while
        print("inercal: stopped", file=sys.stderr)
        sys.exit(130)
    run_verb()


if __name__ == "__main__":
    main()
