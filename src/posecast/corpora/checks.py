"""What looks wrong with the files of a corpus: unreadable, doubled, cut off, missing, mixed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

from posecast.corpora import h36m, symptoms
from posecast.corpora.findings import Evidence, Finding, Severity, some


def _unreadable(evidence: Evidence) -> Iterator[Finding]:
    for fact in evidence.facts:
        if fact.error:
            yield Finding(
                "unreadable", "error", fact.error, "mend the file or take it away", (fact.name,)
            )


def _duplicates(evidence: Evidence) -> Iterator[Finding]:
    by_digest: dict[str, list[str]] = {}
    for fact in evidence.readable:
        if fact.digest:
            by_digest.setdefault(fact.digest, []).append(fact.name)
    for names in by_digest.values():
        if len(names) < 2:
            continue
        purposes = {evidence.splits.get(name) for name in names} - {None}
        uses = some([f"{name} ({evidence.splits.get(name) or 'unused'})" for name in names])
        severity: Severity = "error"
        remedy = "keep one, or results on test files say nothing"
        if len(purposes) < 2:
            severity, remedy = "note", "keep one"
        elif evidence.kind == "h36m":
            severity = "warning"
            remedy = "nothing with the corpus h36m, which does not train on it; else leave it out"
        where = "in different splits" if len(purposes) > 1 else "several times"
        yield Finding("duplicate", severity, f"one recording {where}: {uses}", remedy, tuple(names))


def _cut_off(evidence: Evidence) -> Iterator[Finding]:
    """Test recordings of H3.6M whose length does not fit the published windows."""
    if evidence.kind != "h36m":
        return
    for fact in evidence.readable:
        subject, _, stem = fact.name.removesuffix(".txt").partition("/")
        action, _, recording = stem.rpartition("_")
        if subject != h36m.TEST_SUBJECT or action not in h36m.TEST_FRAMES:
            continue
        low, high = h36m.TEST_FRAMES[action][int(recording) - 1]
        even = (fact.frames + 1) // 2
        if not low <= even <= high:
            yield Finding(
                "length",
                "error",
                f"{even} frames at 25 fps; the published windows need {low} to {high}",
                "copy the file again; until then its action cannot be compared with papers",
                (fact.name,),
            )


def _skeletons(evidence: Evidence) -> Iterator[Finding]:
    found = Counter(fact.skeleton for fact in evidence.readable)
    if len(found) > 1:
        usual = found.most_common(1)[0][0]
        yield Finding(
            "skeleton",
            "error",
            f"{len(found)} different skeletons; the most frequent has {len(usual or ())} joints",
            "a corpus has one: leave the others out, for instance by splits.yaml",
            tuple(fact.name for fact in evidence.readable if fact.skeleton != usual),
        )


def _missing(evidence: Evidence) -> Iterator[Finding]:
    if not evidence.missing:
        return
    remedy = "get the rest where the others are from; what is there can be used"
    if evidence.kind == "h36m":
        tested = [name for name in evidence.missing if name.startswith(f"{h36m.TEST_SUBJECT}/")]
        lost = sorted({name.split("/")[1].rpartition("_")[0] for name in tested})
        remedy = "get them where the others are from; the data cannot be passed on here" + (
            f". Without them evaluation leaves out {', '.join(lost)}" if lost else ""
        )
    yield Finding(
        "missing",
        "warning",
        f"{len(evidence.missing)} files are missing",
        remedy,
        evidence.missing,
    )


def _amass(evidence: Evidence) -> Iterator[Finding]:
    if evidence.kind in ("amass", "amass-first"):
        yield Finding(
            "body",
            "note",
            "the files say how joints turn, not how long bones are",
            "give a template of the body (posecast.io.amass.read_amass) for positions",
        )


def _reader_notes(evidence: Evidence) -> Iterator[Finding]:
    by_note: dict[str, list[str]] = {}
    for fact in evidence.readable:
        for note in fact.notes:
            by_note.setdefault(note, []).append(fact.name)
    for note, names in by_note.items():
        yield Finding("format", "note", note, "check that it is meant", tuple(names))


CHECKS: tuple[Callable[[Evidence], Iterator[Finding]], ...] = (
    _unreadable,
    _duplicates,
    _cut_off,
    _skeletons,
    _missing,
    symptoms.units,
    symptoms.axes,
    symptoms.frame_rate,
    symptoms.jumps,
    symptoms.first_frames,
    symptoms.bones,
    _amass,
    _reader_notes,
)
"""Every check; each gives the findings it comes to."""
