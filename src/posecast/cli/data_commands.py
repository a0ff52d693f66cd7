"""Verbs about motion data: convert, inspect, doctor, view."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from posecast.cli.reading import Reading, check_rate
from posecast.cli.terminal import (
    FpsOption,
    JsonOption,
    PinFeetOption,
    SkeletonOption,
    TemplateOption,
    UnitOption,
    UpOption,
    print_json,
    progress_bar,
    say,
)
from posecast.errors import ConfigError, DataError, PosecastError, SkeletonError

if TYPE_CHECKING:
    from posecast.motion import Clip

MOTION_SUFFIXES = (".bvh", ".amc", ".npz", ".txt")
BODILESS = (
    "the file has no bone lengths, so all joints are at one point; give the body at rest "
    "(--template FILE)"
)


def register(app: typer.Typer) -> None:
    """Add this file's verbs to the command line."""
    app.command(epilog="Example: posecast convert walk.bvh walk.npz")(convert)
    app.command(epilog="Example: posecast inspect walk.bvh")(inspect)
    app.command(epilog="Example: posecast doctor data/h36m")(doctor)
    app.command(epilog="Example: posecast view walk.bvh --out walk.gif")(view)


def convert(
    source: Annotated[Path, typer.Argument(help="A file, or a folder of files (with --to).")],
    target: Annotated[Path, typer.Argument(help="The file or folder to write.")],
    to: Annotated[
        str | None, typer.Option("--to", help="bvh, glb or npz: what a folder is converted to.")
    ] = None,
    fps: FpsOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    skeleton: SkeletonOption = None,
    template: TemplateOption = None,
    resample: Annotated[
        float | None, typer.Option("--resample", help="Frame rate of the output.")
    ] = None,
    pinned: PinFeetOption = False,
) -> None:
    """Convert motion capture: BVH, ASF/AMC, H3.6M text, AMASS or archive to BVH, GLB or archive."""
    reading = Reading(fps, unit=unit, up=up, skeleton=skeleton, template=template)
    if not source.is_dir():
        if to is not None:
            raise ConfigError(
                f"--to {to} is for folders; {source} becomes what the name {target} ends with"
            )
        reading.check([source])
        save_clip(_clip_to_convert(source, reading, resample=resample, pinned=pinned), target)
        return
    if to not in ("bvh", "glb", "npz"):
        raise ConfigError(
            f"{source} is a folder: say what to convert to with --to bvh, --to glb or --to npz"
        )
    places = _places(source, target, f".{to}")
    reading.check(places.values())
    with progress_bar("converting") as advance:
        for done, (written, path) in enumerate(places.items()):
            try:
                clip = _clip_to_convert(path, reading, resample=resample, pinned=pinned)
                written.parent.mkdir(parents=True, exist_ok=True)
                save_clip(clip, written)
            except PosecastError:
                say(f"{done} of {len(places)} files were written to {target} before this one:")
                raise
            advance(done + 1, len(places))
    say(f"{len(places)} files written to {target}")


def inspect(
    files: Annotated[list[Path], typer.Argument(help="Motion files.")],
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print JSON and nothing else: an object, or a list of them."),
    ] = False,
    fps: FpsOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    skeleton: SkeletonOption = None,
    template: TemplateOption = None,
) -> None:
    """Say what is in a motion file: joints, body, frame rate, length, extent, notes."""
    reading = Reading(fps, unit=unit, up=up, skeleton=skeleton, template=template)
    reading.check(files)
    facts = [_facts(path, reading.clip(path)) for path in files]
    if as_json:
        print_json(facts[0] if len(facts) == 1 else facts)
        return
    for fact in facts:
        _print_facts(fact)


def doctor(
    path: Annotated[Path, typer.Argument(help="A folder of motion capture, or one file.")],
    as_json: JsonOption = False,
) -> None:
    """Say which corpus a folder is, what is missing, what looks wrong, and what to do.

    Exit code 1 if there is nothing to read or a finding is an error.
    """
    from posecast.corpora.doctor import examine

    with progress_bar("examining") as advance:
        report = examine(path, progress=advance)
    if as_json:
        print_json(report.to_json())
    else:
        typer.echo(report.text())
    if not report.is_sound:
        raise typer.Exit(1)


def view(
    clips: Annotated[
        list[Path],
        typer.Argument(help="Clips, drawn side by side; the first of several is grey, the truth."),
    ],
    out: Annotated[Path, typer.Option("--out", help="X.png (a strip), X.gif or X.mp4.")],
    fps: FpsOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    skeleton: SkeletonOption = None,
    template: TemplateOption = None,
    split_ms: Annotated[
        float | None, typer.Option("--split-ms", help="Frames after this time are the forecast.")
    ] = None,
) -> None:
    """Draw one or several clips without a display."""
    from posecast.io.atomic import check_target
    from posecast.viewer import draw

    check_target(out)
    reading = Reading(fps, unit=unit, up=up, skeleton=skeleton, template=template)
    reading.check(clips)
    loaded = [reading.clip(path) for path in clips]
    for path, clip in zip(clips, loaded, strict=True):
        if clip.labels.get("offsets") == "unknown":
            raise ConfigError(f"{path}: {BODILESS}")
    longest = max(clip.duration for clip in loaded) * 1000
    if split_ms is not None and not 0 <= split_ms < longest:
        raise ConfigError(
            f"--split-ms {split_ms:g}: expected a time in the clip, 0 to {longest:.0f} ms"
        )
    split = None if split_ms is None else round(split_ms / 1000 * loaded[0].fps)
    with progress_bar("drawing") as advance:
        draw(
            loaded,
            out,
            titles=[path.stem for path in clips],
            split_frame=split,
            progress=advance,
        )
    say(f"{out} written")


def save_clip(clip: Clip, path: Path) -> None:
    """Write any motion file, and say what its format could not keep."""
    from posecast.io import write_clip

    notes = write_clip(clip, path)
    if clip.labels.get("offsets") == "unknown" and path.suffix.lower() in (".bvh", ".glb"):
        notes = (*notes, BODILESS)
    for note in notes:
        say(f"note: {path}: {note}")


def _places(source: Path, target: Path, suffix: str) -> dict[Path, Path]:
    """For each file to be written the one it is made from; no two alike, none of them a source.

    Of text files only those that Human3.6M's names fit are motion; the others are licences.
    """
    from posecast.corpora.h36m import is_recording

    files = sorted(
        path
        for path in source.rglob("*")
        if path.suffix.lower() in MOTION_SUFFIXES
        and (path.suffix.lower() != ".txt" or is_recording(path.resolve()))
    )
    if not files:
        raise DataError(source, f"no motion found; looked for {', '.join(MOTION_SUFFIXES)}")
    known = {path.resolve() for path in files}
    places: dict[Path, Path] = {}
    for path in files:
        written = (target / path.relative_to(source)).with_suffix(suffix)
        if written in places:
            raise ConfigError(
                f"{places[written]} and {path} would both become {written}; convert one of them "
                "by itself, under another name"
            )
        if written.resolve() in known:
            raise ConfigError(f"{written} is there to be read; choose another folder to write")
        places[written] = path
    return places


def _clip_to_convert(path: Path, reading: Reading, *, resample: float | None, pinned: bool) -> Clip:
    from posecast.motion import pin_feet, transforms

    clip = reading.clip(path)
    if resample is not None:
        check_rate("--resample", resample)
        clip = transforms.resample(clip, resample, phases="first")[0]
    if not pinned:
        return clip
    try:
        clip, report = pin_feet(clip)
    except SkeletonError as error:
        raise SkeletonError(f"{path}: {error}") from None
    say(f"{path}: {report.text()}")
    return clip


def _print_facts(fact: dict[str, Any]) -> None:
    """What ``inspect`` found, for people."""
    joints, notes = fact.pop("joints"), fact.pop("notes")
    typer.echo(fact.pop("file"))
    for key, value in fact.items():
        typer.echo(f"  {key}: {value}")
    for note in notes:
        typer.echo(f"  note: {note}")
    typer.echo(f"  joints: {len(joints)}")
    for joint in joints:
        parent = joint["parent"] or "world"
        typer.echo(f"    {joint['name']} < {parent}, {joint['length_m']:.3f} m")


def _facts(path: Path, clip: Clip) -> dict[str, Any]:
    from posecast.skeleton.kinematics import joint_positions

    skeleton = clip.skeleton
    offsets = clip.offsets if clip.translations_local is None else clip.translations_local
    positions = joint_positions(skeleton, clip.rotations_local, offsets, clip.root_positions)
    low, high = positions.amin(dim=(0, 1)).tolist(), positions.amax(dim=(0, 1)).tolist()
    heights = positions[..., 1].amax(-1) - positions[..., 1].amin(-1)
    return {
        "file": str(path),
        "frames": clip.frames,
        "fps": clip.fps,
        "seconds": round(clip.duration, 3),
        "height_m": round(float(heights.median()), 3),
        "extent_m": [round(b - a, 3) for a, b in zip(low, high, strict=True)],
        "bones_move": clip.translations_local is not None,
        "labels": dict(clip.labels),
        "tracks": sorted(clip.tracks),
        "notes": [
            *getattr(clip.source, "notes", ()),
            *([BODILESS] if clip.labels.get("offsets") == "unknown" else []),
        ],
        "joints": [
            {
                "name": name,
                "parent": None if parent < 0 else skeleton.names[parent],
                "length_m": float(offset.norm()),
            }
            for name, parent, offset in zip(
                skeleton.names, skeleton.parents, clip.offsets, strict=True
            )
        ],
    }
