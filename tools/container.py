"""Build the container and run it: ``python -m tools.container``.

With podman, buildah or docker, the image is built and the demonstration runs in it. Otherwise the
steps are read from the Containerfile and carried out in a temporary folder: all stages share this
folder, its Python is the one that runs this program, and its user is the one who runs it, without
the right to write to the installation. Either way, the demonstration must find its kernels and
add none to them.
"""

import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
CONTAINERFILE, IGNORED = ROOT / "Containerfile", ROOT / ".containerignore"
TAG = "inercal"
PROBE = ["python", "-m", "pip", "download", "--quiet", "--no-deps", "--dest", "probe", "pip"]
# In the end, the numbers of kernels that were linked to the installation, and that were compiled.
_FOUND = 'find "$HOME/.cache/numba" -name "*.nb[ci]" -type'
DEMO = f"inercal demo --quick --out /data/demo && {_FOUND} l | wc -l && {_FOUND} f | wc -l"
_PLACES = re.compile(r"(?<![\w./-])/(?=(opt|src|data|tmp)\b)")  # folders of the image
_VARIABLE = re.compile(r"\$\{?(\w+)\}?")


class Step(NamedTuple):
    """An instruction of a Containerfile, such as ("RUN", "make all")."""

    name: str
    text: str


def steps(text: str) -> list[Step]:
    """Return the instructions of a Containerfile, without comments and with lines joined."""
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    joined = "\n".join(lines).replace("\\\n", " ")
    return [Step(*line.split(maxsplit=1)) for line in joined.splitlines() if line.strip()]


def is_ignored(path: PurePath, patterns: Sequence[str]) -> bool:
    """Return whether a file of the repository is kept out of the build; the last pattern counts."""
    ignored = False
    for pattern in patterns:
        plain = pattern.removeprefix("!")
        if plain.startswith("**/"):
            found = any(fnmatch(part, plain[3:]) for part in path.parts)
        else:
            depth = plain.count("/") + 1
            found = fnmatch("/".join(path.parts[:depth]), plain)
        ignored = pattern == plain if found else ignored
    return ignored


def ignore_patterns(text: str) -> list[str]:
    """Return the patterns of a .containerignore."""
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


class Folder:
    """A temporary folder in which the steps are carried out in place of an image."""

    def __init__(self, root: Path):
        self.root, self.place = root, root
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        self.entry: list[str] = []
        for name in ("base", "opt", "tmp"):
            (root / name).mkdir()
        subprocess.run([sys.executable, "-m", "venv", root / "base"], check=True)
        self.environment |= {"PATH": f"{root / 'base' / 'bin'}{os.pathsep}{os.environ['PATH']}"}

    def carry_out(self, step: Step) -> None:
        """Carry out one instruction."""
        text = _PLACES.sub(f"{self.root}/", step.text)
        if step.name == "RUN":
            self.run(["sh", "-ec", text])
        elif step.name == "ENV":
            pairs = (one.partition("=") for one in shlex.split(text))
            known = self.environment
            self.environment = known | {
                name: _VARIABLE.sub(lambda found: known.get(found[1], ""), value)
                for name, _, value in pairs
            }
        elif step.name == "WORKDIR":
            self.place = Path(text)
            self.place.mkdir(parents=True, exist_ok=True)
        elif step.name == "COPY":
            self._copy(text.split())
        elif step.name == "ENTRYPOINT":
            self.entry = json.loads(text)
        elif step.name not in ("FROM", "USER", "EXPOSE", "STOPSIGNAL", "CMD"):
            raise SystemExit(f"Containerfile: {step.name} cannot be carried out in a folder")

    def _copy(self, words: list[str]) -> None:
        """Copy files of the repository; those from another stage are in the folder already."""
        if words[0].startswith("--from="):
            assert words[1] == words[2], words
            return
        patterns = ignore_patterns(IGNORED.read_text(encoding="utf-8"))
        *sources, target = words
        for source in sources:
            own = self.place / target
            files = [ROOT / source] if (ROOT / source).is_file() else (ROOT / source).rglob("*")
            for file in files:
                if not file.is_file() or is_ignored(file.relative_to(ROOT), patterns):
                    continue
                within = file.name if file == ROOT / source else file.relative_to(ROOT / source)
                (own / within).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, own / within)

    def run(self, command: Sequence[str]) -> str:
        """Run a command as a step does, and return what it prints."""
        done = subprocess.run(
            command,
            cwd=self.place,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(f"{shlex.join(command)}\n{done.stdout[-4000:]}")
        return done.stdout

    def run_installed(self, command: str) -> str:
        """Run a shell command with an installation that can be read, but not be written to."""
        installed = self.root / "opt"
        others = [path for path in installed.rglob("*") if not path.stat().st_mode & 0o004]
        if others:
            raise SystemExit(f"not every user can read {others[0]}")
        self.run(["chmod", "-R", "a-w", str(installed)])
        # Permissions do not count for root, unless it gives up its capabilities.
        drop = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.getuid() == 0 else []
        return self.run([*drop, "sh", "-ec", _PLACES.sub(f"{self.root}/", command)])


def processor_seconds() -> float:
    """Return the processor time of all commands that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def builder() -> str | None:
    """Return the name of a program that gets the image to begin with, and a package in it."""
    content = steps(CONTAINERFILE.read_text(encoding="utf-8"))
    base = next(step.text.split()[0] for step in content if step.name == "FROM")
    for name in ("podman", "buildah", "docker"):
        ask = [name, "run", "--rm", base, *PROBE]
        if shutil.which(name):
            probe = [name, "pull", base] if name == "buildah" else ask
            if not subprocess.run(probe, capture_output=True, check=False).returncode:
                return name
    return None


def build_image(name: str) -> str:
    """Build the image, run the demonstration in it, and return what it prints."""
    subprocess.run([name, "build", "-t", TAG, "-f", CONTAINERFILE, ROOT], check=True)
    if name == "buildah":  # it uses no entry point when it runs something
        (made,) = subprocess.check_output([name, "from", TAG], text=True).split()
        command = [name, "run", made, "--", "sh", "-ec", DEMO]
    else:
        command = [name, "run", "--rm", "--entrypoint", "sh", TAG, "-ec", DEMO]
    return subprocess.check_output(command, text=True)


def carry_out_in_folder() -> str | None:
    """Carry out all steps here, and return what the demonstration prints; None without an index."""
    with TemporaryDirectory(prefix="container-") as name:
        folder = Folder(Path(name))
        if subprocess.run(PROBE, cwd=name, env=folder.environment, check=False).returncode:
            return None
        for step in steps(CONTAINERFILE.read_text(encoding="utf-8")):
            before = processor_seconds()
            folder.carry_out(step)
            used = processor_seconds() - before
            print(f"{used:5.1f} s  {step.name} {' '.join(step.text.split())}", flush=True)
        assert DEMO.startswith(f"{' '.join(folder.entry)} ")
        printed = folder.run_installed(DEMO)
        folder.run(["chmod", "-R", "u+w", str(folder.root / "opt")])
        return printed


def main() -> None:
    """Build and run the container, and check that its first run compiles no kernel."""
    name = builder()
    print(f"container: {name or 'no builder that works; its steps are carried out in a folder'}")
    printed = build_image(name) if name else carry_out_in_folder()
    if printed is None:
        print("container: skipped, because no package index can be reached")
        return
    linked, compiled = map(int, printed.split()[-2:])
    if compiled or not linked:
        raise SystemExit(
            f"container: {linked} files of kernels, but the first run added {compiled}"
        )
    print(f"container: {linked} files of kernels, to which the first run added none")
    print(f"container: {processor_seconds():.0f} s of processor time")


if __name__ == "__main__":
    main()
