"""The `inercal` program, also `python -m inercal`: it prepares its process, then loads the verbs.

Worker processes import this module; they need no verb.
"""

import sys

from inercal.basics.process_settings import prepare_process


def main() -> None:
    """Run the program; an error of the input is one line on standard error and status 2."""
    try:
        prepare_process()
        from inercal.cli.app import main as run_verb
    except KeyboardInterrupt:  # to load the verbs takes a while
        print("inercal: stopped", file=sys.stderr)
        sys.exit(130)
    run_verb()


if __name__ == "__main__":
    main()
