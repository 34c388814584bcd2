"""Output files of `inercal noise`: files for other programs, and sections of a run file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from inercal.basics.atomic_files import keep_previous, write_text
from inercal.basics.errors import InputError
from inercal.cli.outputs import RUN_FILE, OutputKind, check_outputs

if TYPE_CHECKING:
    from inercal.noise.sensor_noise import SensorNoise


@dataclass(frozen=True)
class NoiseFiles:
    """Output files to write, and their folder.

    Parameters
    ----------
    to : sequence of str
        Names of other programs, which are keys of `WRITERS`.
    horizon : float
        Time, s, at which a random walk equals the bias instability that it replaces.
    section : Path or None
        Run file into which the noise is written.
    out : Path
        Folder for the files for other programs.
    force : bool
    """

    to: Sequence[str]
    horizon: float
    section: Path | None
    out: Path
    force: bool

    @property
    def are_wanted(self) -> bool:
        """Return whether there is anything to write."""
        return bool(self.to) or self.section is not None

    def _texts(self, stem: str) -> dict[str, Path]:
        return {one: self.out / f"{stem}.{one}.yaml" for one in self.to}

    def check(self, stem: str, inputs: Sequence[Path]) -> None:
        """Raise an error before the work if a file must not or cannot be written.

        Parameters
        ----------
        stem : str
            First part of the file names.
        inputs : sequence of Path
            Files that are read. With --force, the noise may be written to the run file among them.
        """
        kind = OutputKind("noise file")  # users edit such a file, for example its topics
        check_outputs(dict.fromkeys(self._texts(stem).values(), kind), inputs, force=self.force)
        if self.section is not None:
            others = [
                one for one in inputs if not (self.force and self.section == inputs[0] == one)
            ]
            check_outputs({self.section: RUN_FILE}, others, force=self.force)

    def write(self, stem: str, noise: "SensorNoise") -> dict[str, Path | str]:
        """Write the files and return their paths."""
        from inercal.noise.noise_files import WRITERS

        texts = self._texts(stem)
        # All texts are made before the first is written, so that an error leaves no files.
        contents = {one: WRITERS[one](noise, self.horizon) for one in texts}
        merged = "" if self.section is None else _merged_run_file(noise, self.section)
        files: dict[str, Path | str] = {}
        for one, path in texts.items():
            files[one] = write_text(path, contents[one])
        if self.section is not None:
            keep_previous(self.section)
            files["run_file"] = write_text(self.section, merged)
        return files


def _merged_run_file(noise: "SensorNoise", path: Path) -> str:
    """Return the text of a run file after adding the noise to its sections."""
    from inercal.basics.small_files import parse_toml
    from inercal.noise.noise_files import NOISE_KEYS, merge_sections, run_file_sections

    text = path.read_text(encoding="utf-8") if path.exists() else ""
    # A data sheet adds some of the keys; an analysis replaces those from an earlier analysis.
    replaced = () if noise.is_data_sheet else NOISE_KEYS
    merged = merge_sections(text, run_file_sections(noise), replaced)
    try:
        parse_toml(merged, "run file")
    except InputError as error:
        raise InputError(
            f"the noise cannot be written to this file ({error}): choose a new file"
        ).located(path) from None
    return merged
