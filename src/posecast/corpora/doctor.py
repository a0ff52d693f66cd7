"""Which corpus a folder is, what is missing in it, what looks wrong, and what to do."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from posecast.corpora import amass, amass_first, bandai, cmu, folder, h36m
from posecast.corpora.checks import CHECKS
from posecast.corpora.examination import Facts, Format, examine_file
from posecast.corpora.findings import Evidence, Finding
from posecast.corpora.loading import Progress
from posecast.corpora.splitting import choose_splits
from posecast.errors import ConfigError, DataError
from posecast.io.amass import is_amass
from posecast.io.array_pickle import read_array_pickle
from posecast.io.arrays import array_names

_NOT_READ = (".fbx", ".c3d", ".pkl", ".mat", ".cdf", ".zip", ".tar", ".gz", ".xz", ".7z", ".rar")
_SHOWN = 6


class _Found(NamedTuple):
    """A file that may hold motion: which corpus it would be of, its format, its usual name."""

    kind: str
    format: Format
    name: str


@dataclass(frozen=True)
class Report:
    """What was found in a folder or a file.

    Args:
        path: what was examined.
        corpus: name for ``build_corpus``; "" if it is none, as single archives are.
        format: how the files are written: bvh, amc, h36m, amass, archive; "" without files.
        files: how many there are of it.
        frames: of all files that can be read, together.
        joints: their numbers of joints, each once.
        fps: frames per second that they claim, each once.
        minutes: duration of all together; of cmu-salsa at its true rate.
        height: median height that the body reaches, meters; ``None`` if the files do not tell.
        unit: meters per unit of most files, if guessed.
        up: vertical axis of most files, if guessed or measured.
        missing: files that the corpus should have.
        findings: the gravest first.
    """

    path: str
    corpus: str
    format: str
    files: int
    frames: int = 0
    joints: tuple[int, ...] = ()
    fps: tuple[float, ...] = ()
    minutes: float = 0.0
    height: float | None = None
    unit: float | None = None
    up: str = ""
    missing: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def is_sound(self) -> bool:
        """Whether there is anything to read and no finding is an error."""
        return self.files > 0 and all(finding.severity != "error" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Plain dictionaries, lists, text and numbers."""
        return dataclasses.asdict(self)

    def text(self) -> str:
        """For people: what it is, then every finding with its remedy."""
        what = self.corpus or "no corpus posecast knows by name"
        lines = [f"{self.path}: {what}"]
        if self.files:
            joints = " or ".join(map(str, self.joints)) or "no"
            rates = " or ".join(f"{fps:g}" for fps in self.fps) or "?"
            if self.corpus == "cmu-salsa":
                rates = f"{cmu.SALSA_FPS:g} (headers: {rates})"
            lines.append(
                f"  {self.files} files ({self.format}), {self.frames} frames, {joints} joints, "
                f"{rates} fps, {self.minutes:.1f} minutes"
            )
        facts = []
        if self.unit:
            facts.append(f"unit {self.unit:g} m")
        if self.up:
            facts.append(f"{self.up} up")
        if self.height:
            facts.append(f"reaches {self.height:.2f} m high")
        if facts:
            lines.append(f"  {', '.join(facts)}")
        for finding in self._shown():
            where = f" [{_listed(finding.files)}]" if finding.files else ""
            lines.append(f"  {finding.severity}: {finding.message}{where}")
            lines.append(f"    -> {finding.remedy}")
        if not self.findings:
            lines.append("  nothing looks wrong")
        return "\n".join(lines)

    def _shown(self) -> Iterator[Finding]:
        """All findings; of a kind that fills the page the first few and one for the rest."""
        seen: Counter[str] = Counter()
        for finding in self.findings:
            seen[finding.problem] += 1
            if seen[finding.problem] <= _SHOWN:
                yield finding
            elif seen[finding.problem] == _SHOWN + 1:
                alike = [other for other in self.findings if other.problem == finding.problem]
                yield dataclasses.replace(
                    finding,
                    message=f"{finding.problem}: {len(alike) - _SHOWN} more like these",
                    files=tuple(file for other in alike[_SHOWN:] for file in other.files),
                )


def examine(path: Path | str, *, progress: Progress | None = None) -> Report:
    """Examine a folder, with all folders in it, or a single file.

    Every motion file is read once, so this takes about as long as reading the corpus. A file that
    cannot be read is a finding and stops nothing.

    Args:
        path: folder or file.
        progress: called with files read and files in all.

    Raises:
        DataError: there is no such folder or file.
    """
    top = Path(path)
    if not top.exists():
        raise DataError(path, "there is no such folder or file")
    found = _find(top)
    if not found:
        return Report(str(path), "", "", 0, findings=(_nothing(top),))
    kinds = Counter(motion.kind for motion in found.values())
    kind = kinds.most_common(1)[0][0]
    chosen = {file: motion for file, motion in found.items() if motion.kind == kind}
    facts = []
    for number, (file, motion) in enumerate(chosen.items(), start=1):
        facts.append(examine_file(motion.name, file, motion.format))
        if progress:
            progress(number, len(chosen))
    names = [motion.name for motion in chosen.values()]
    splits, doubt = _splits(kind, names, top)
    missing = _missing(kind, names) if top.is_dir() else ()
    evidence = Evidence(kind, tuple(facts), splits, missing)
    findings = [finding for check in CHECKS for finding in check(evidence)]
    findings += [*doubt, *_others(kinds, kind), *_not_read(top, found)]
    findings.sort(key=lambda finding: ("error", "warning", "note").index(finding.severity))
    return _report(str(path), evidence, next(iter(chosen.values())).format, tuple(findings))


def _report(path: str, evidence: Evidence, format: Format, findings: tuple[Finding, ...]) -> Report:
    readable = evidence.readable
    salsa = evidence.kind == "cmu-salsa"
    heights = [fact.height for fact in readable if fact.height > 0]
    return Report(
        path=path,
        corpus=evidence.kind,
        format=format,
        files=len(evidence.facts),
        frames=sum(fact.frames for fact in readable),
        joints=tuple(sorted({len(fact.skeleton) for fact in readable if fact.skeleton})),
        fps=tuple(sorted({fact.fps for fact in readable})),
        minutes=sum(
            fact.frames / (min(fact.fps, cmu.SALSA_FPS) if salsa else fact.fps) / 60
            for fact in readable
        ),
        height=median(heights) if heights else None,
        unit=_usual([fact.unit for fact in readable if fact.unit]),
        up=_usual([fact.up for fact in readable if fact.up]) or "",
        missing=evidence.missing,
        findings=findings,
    )


def _usual(values: list[Any]) -> Any:
    return Counter(values).most_common(1)[0][0] if values else None


def _find(top: Path) -> dict[Path, _Found]:
    """The files that may hold motion, in the order of their paths."""
    files = [top] if top.is_file() else sorted(file for file in top.rglob("*") if file.is_file())
    found = {}
    for file in files:
        name = file.name if top.is_file() else file.relative_to(top).as_posix()
        motion = _recognise(file, name)
        if motion:
            found[file] = motion
    return found


def _recognise(file: Path, name: str) -> _Found | None:
    """What a file is by its name, and for .npz by the names of its arrays."""
    match file.suffix.lower():
        case ".bvh" if re.fullmatch(cmu.SALSA_PATTERN, file.name, re.IGNORECASE):
            return _Found("cmu-salsa", "bvh", cmu.usual_name(file))
        case ".bvh" if re.fullmatch(bandai.PATTERN, file.name, re.IGNORECASE):
            return _Found("bandai-locomotion", "bvh", file.name.lower())
        case ".bvh":
            return _Found("folder", "bvh", name)
        case ".amc" if re.fullmatch(cmu.ASF_PATTERN, file.name, re.IGNORECASE):
            return _Found("cmu-asf", "amc", cmu.usual_name(file))
        case ".amc":
            return _Found("", "amc", name)
        case ".txt" if h36m.is_recording(file):
            return _Found("h36m", "h36m", h36m.usual_name(file))
        case ".npz":
            return _recognise_npz(file, name)
        case ".pkl" if _holds_poses(file):
            return _Found("amass-first", "pickle", name)
    return None


def _recognise_npz(file: Path, name: str) -> _Found | None:
    try:
        arrays = array_names(file)
    except DataError:
        return _Found("amass", "amass", name)  # reading it again will say what is wrong
    if is_amass(arrays):
        return _Found("amass", "amass", name)
    return _Found("", "archive", name) if "rotations_local" in arrays else None


def _holds_poses(file: Path) -> bool:
    """Whether a pickle is a recording; what else it may be is not read."""
    try:
        return "poses" in read_array_pickle(file)
    except DataError:
        return False


def _splits(
    kind: str, names: list[str], top: Path
) -> tuple[Mapping[str, str | None], list[Finding]]:
    """What each file would be for, and a finding if that cannot be said."""
    rules: dict[str, Callable[[list[str]], Mapping[str, str | None]]] = {
        "h36m": h36m.file_splits,
        "cmu-salsa": cmu.salsa_splits,
        "cmu-asf": cmu.asf_splits,
        "bandai-locomotion": bandai.file_splits,
    }
    if not top.is_dir():
        return {}, []
    if kind in rules:
        return rules[kind](names), []
    if kind == "amass-first":
        try:
            return amass_first.file_splits(names, top), []
        except DataError as error:
            remedy = "copy the three published lists there, or say where they are: corpus.lists=DIR"
            return {}, [Finding("splits", "error", str(error), remedy)]
    if kind not in ("folder", "amass"):
        return {}, []
    rule = folder.file_splits if kind == "folder" else amass.file_splits
    try:
        return choose_splits(names, top, None, otherwise=rule, rule="")[0], []
    except ConfigError as error:
        return {}, [Finding("splits", "error", str(error), "mend splits.yaml")]


def _missing(kind: str, names: list[str]) -> tuple[str, ...]:
    expected = {"h36m": h36m.FILES, "cmu-salsa": cmu.SALSA_FILES, "cmu-asf": cmu.ASF_FILES}
    if kind == "bandai-locomotion":
        return bandai.gaps(names)
    return tuple(name for name in expected.get(kind, ()) if name not in names)


def _others(kinds: Counter[str], kind: str) -> list[Finding]:
    return [
        Finding(
            "mixture",
            "warning",
            f"there are also {count} files of {other or 'other motion'}, not examined",
            "give each corpus a folder of its own",
        )
        for other, count in kinds.most_common()
        if other != kind
    ]


def _nothing(top: Path) -> Finding:
    return Finding(
        "nothing",
        "error",
        "no motion is there" if top.is_dir() else "this is no motion file that posecast reads",
        "expected BVH, AMC with its ASF, H3.6M exponential maps (S1/walking_1.txt), SMPL or "
        "posecast .npz",
    )


def _not_read(top: Path, read: Collection[Path]) -> list[Finding]:
    """Formats that may hold motion but are not read."""
    if not top.is_dir():
        return []
    found = Counter(
        file.suffix.lower()
        for file in top.rglob("*")
        if file.suffix.lower() in _NOT_READ and file not in read and file.is_file()
    )
    return [
        Finding(
            "not read",
            "note",
            f"{count} files *{suffix} are not read",
            "unpack archives; convert other motion to BVH",
        )
        for suffix, count in found.most_common()
    ]


def _listed(files: tuple[str, ...]) -> str:
    more = f" and {len(files) - _SHOWN} more" if len(files) > _SHOWN else ""
    return ", ".join(files[:_SHOWN]) + more


__all__ = ["Facts", "Finding", "Report", "examine"]
