"""Several bodies at once: which motion is on which body in which split, and how it is called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch.testing import assert_close

from posecast.corpora import build_corpus
from posecast.corpora.bodies import ASF_TEST, ASF_VALIDATION, MADE_BODIES, UNSEEN
from posecast.corpora.cmu import ASF_FILES
from posecast.corpora.gait.body import CAST
from posecast.corpora.synthetic import make_clip
from posecast.errors import ConfigError, DataError
from posecast.motion import Clip, Corpus
from posecast.skeleton import joint_positions

Write = Callable[..., Path]

SHIN = """  begin
     id 2
     name ltibia
     direction 0 -1 0
     length {length}
     axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root lfemur
    lfemur ltibia
"""


def small(**options: object) -> Corpus:
    return build_corpus("bodies", **{"clips": 12, "seconds": 1.0, "fps": 25.0, **options})  # type: ignore[arg-type]


def groups(corpus: Corpus, split: str) -> Counter[str]:
    return Counter(clip.labels["scenario"] for clip in corpus.split(split))


def motions(corpus: Corpus, split: str, scenario: str = "") -> set[str]:
    return {c.labels["motion"] for c in corpus.split(split) if scenario in c.labels["scenario"]}


@pytest.fixture
def write_people(write_amc: Write) -> Callable[..., Path]:
    """Write trials of CMU's format whose people have thighs of different lengths."""

    def write(names: list[str]) -> Path:
        root = write_amc(names)
        for asf in root.glob("*/*.asf"):
            text = asf.read_text()
            shin = SHIN.format(length=3 + int(asf.stem))
            asf.write_text(text.replace(":hierarchy\n  begin\n    root lfemur\n", shin))
        return root

    return write


def check_separation(corpus: Corpus, unseen: set[str]) -> None:
    """What every corpus of several bodies promises."""
    held_out = motions(corpus, "validation") | motions(corpus, "test", "unseen motion")
    known = motions(corpus, "test", ", seen motion")
    assert held_out, "there is something to test with"
    assert known
    assert not held_out & motions(corpus, "train")
    assert known <= motions(corpus, "train")
    assert not motions(corpus, "validation") & motions(corpus, "test")
    trained = {clip.labels["body"] for clip in corpus.split("train")}
    assert not trained & unseen
    assert {clip.labels["body"] for clip in corpus.split("validation")} <= trained
    for clip in corpus.clips:
        body, scenario = clip.labels["body"], clip.labels["scenario"]
        kind = "unseen" if body in unseen else "seen"
        assert scenario.startswith(f"{kind} body ({body}), ")
    places = sorted(place for split in corpus.splits.values() for place in split)
    assert places == list(range(len(corpus.clips))), "each clip is in one split"


def test_made_motions_are_given_every_body_of_the_cast() -> None:
    corpus = small()
    assert (corpus.name, corpus.fps) == ("bodies of synthetic", 25)
    check_separation(corpus, {"average", "tall"})
    seen = sorted(body.name for body in CAST if body.name not in ("average", "tall"))
    assert groups(corpus, "train") == {f"seen body ({body}), seen motion": 8 for body in seen}
    assert groups(corpus, "validation") == {
        f"seen body ({body}), unseen motion": 2 for body in seen
    }
    scenarios = groups(corpus, "test")
    assert sorted(scenarios.items()) == [
        *((f"seen body ({body}), unseen motion", 2) for body in seen),
        ("unseen body (average), seen motion", 6),
        ("unseen body (average), unseen motion", 2),
        ("unseen body (tall), seen motion", 6),
        ("unseen body (tall), unseen motion", 2),
    ]
    assert "unseen: average, tall" in " ".join(corpus.notes)


def test_one_unseen_body_is_within_the_range_of_the_seen_and_one_beyond() -> None:
    def heights(corpus: Corpus, split: str) -> dict[str, float]:
        found = {}
        for clip in corpus.split(split):
            rest = torch.zeros(1, len(corpus.skeleton), 4, dtype=clip.offsets.dtype)
            rest[..., 0] = 1
            place = joint_positions(
                corpus.skeleton, rest, clip.offsets, torch.zeros(1, 3).to(clip.offsets)
            )[..., 1]
            found[clip.labels["body"]] = float(place.amax() - place.amin())
        return found

    corpus = small()
    seen, all_of_them = heights(corpus, "train").values(), heights(corpus, "test")
    assert min(seen) < all_of_them["average"] < max(seen) < all_of_them["tall"]


def test_a_motion_is_the_same_on_every_body_and_kept_on_its_own() -> None:
    corpus = small()
    by_motion: dict[str, list[Clip]] = {}
    for clip in corpus.clips:
        by_motion.setdefault(clip.labels["motion"], []).append(clip)
    assert len(by_motion) == 12
    bodies = {body.name: body.offsets for body in CAST}
    kept = 0
    for index, (motion, clips) in enumerate(sorted(by_motion.items())):
        recorded = make_clip(index, fps=25.0, seconds=1.0)
        assert motion == recorded.name
        for clip in clips:
            assert clip.rotations_local.data_ptr() == clips[0].rotations_local.data_ptr()
            assert torch.equal(clip.rotations_local, recorded.rotations_local)
            assert torch.equal(clip.offsets, bodies[clip.labels["body"]])
            assert clip.labels["subject"] == recorded.labels["subject"]
            if clip.labels["body"] == recorded.labels["body"]:
                kept += 1
                assert torch.equal(clip.root_positions, recorded.root_positions)
                assert clip.name == recorded.name
            else:
                assert not torch.equal(clip.root_positions, recorded.root_positions)
                assert clip.name == f"{recorded.name} on {clip.labels['body']}"
    assert kept > 6


def test_groups_of_one_kind_have_the_same_motions() -> None:
    corpus = small(clips=24, group_size=3)
    for kind in ("unseen motion", ", seen motion"):
        by_group: dict[str, list[str]] = {}
        for clip in corpus.split("test"):
            if kind in clip.labels["scenario"]:
                by_group.setdefault(clip.labels["scenario"], []).append(clip.labels["motion"])
        assert len(by_group) == (8 if kind == "unseen motion" else 2)
        assert len({tuple(motions) for motions in by_group.values()}) == 1
    assert set(groups(corpus, "test").values()) == {3}


def test_a_small_group_has_motions_of_many_actions() -> None:
    corpus = small(clips=36, seconds=0.2, fps=10.0)
    seen = [c for c in corpus.split("test") if "(tall), seen motion" in c.labels["scenario"]]
    assert len({clip.labels["action"] for clip in seen}) >= 4


def test_bodies_left_out_can_be_chosen() -> None:
    corpus = small(unseen="child")
    check_separation(corpus, {"child"})
    assert "tall" in {clip.labels["body"] for clip in corpus.split("train")}
    both = small(unseen=["stocky", "child", "child"])
    check_separation(both, {"child", "stocky"})


def test_people_are_trained_on_their_own_bodies(write_people: Callable[..., Path]) -> None:
    root = write_people(list(ASF_FILES))
    corpus = build_corpus("bodies", root=root, of="cmu-asf", cache=False)
    check_separation(corpus, {"03"})
    assert corpus.missing == ()
    assert groups(corpus, "train") == {
        "seen body (01), seen motion": 4 * 11,
        "seen body (02), seen motion": 4 * 7,
    }
    assert groups(corpus, "validation") == {
        "seen body (01), unseen motion": 1,
        "seen body (02), unseen motion": 1,
    }
    assert sorted(groups(corpus, "test").items()) == [
        ("seen body (01), unseen motion", 2),
        ("seen body (02), unseen motion", 2),
        ("unseen body (03), seen motion", 6),
        ("unseen body (03), unseen motion", 4),
        ("unseen body (03), unseen motion of its own person", 4),
    ]
    assert all(
        clip.labels["body"] == clip.labels["subject"]
        for clip in corpus.clips
        if "unseen body" not in clip.labels["scenario"]
    )
    held_out = (*corpus.split("validation"), *corpus.split("test"))
    assert {clip.labels["phase"] for clip in held_out} == {"0"}, "not the same motion four times"
    own = [c for c in corpus.split("test") if "own person" in c.labels["scenario"]]
    assert {clip.labels["subject"] for clip in own} == {"03"}
    (third,) = {tuple(clip.offsets[2].tolist()) for clip in own}
    borrowed = corpus.split("test", {"body": "03", "subject": ["01", "02"]})
    assert len(borrowed) == 10
    assert {tuple(clip.offsets[2].tolist()) for clip in borrowed} == {third}
    text = " ".join(corpus.notes)
    assert "Validation: trials 02 and 09" not in text, "that is another corpus's split"
    assert all(name in text for name in (*ASF_TEST, *ASF_VALIDATION))


def test_another_person_can_be_the_stranger(write_people: Callable[..., Path]) -> None:
    root = write_people(list(ASF_FILES))
    corpus = build_corpus("bodies", root=root, of="cmu-asf", unseen=2, cache=False)
    check_separation(corpus, {"02"})
    assert groups(corpus, "train")["seen body (03), seen motion"] == 4 * 2
    assert groups(corpus, "test")["unseen body (02), unseen motion of its own person"] == 6


def test_trials_that_are_held_out_have_others_in_training() -> None:
    assert set(ASF_TEST) | set(ASF_VALIDATION) < set(ASF_FILES)
    assert not set(ASF_TEST) & set(ASF_VALIDATION)
    for subject in ("01", "02", "03"):
        for held_out in (ASF_TEST, ASF_VALIDATION):
            assert any(name.startswith(subject) for name in held_out)


def test_a_dancer_is_given_made_bodies(write_walks: Write) -> None:
    root = write_walks([f"61/61_{n}.bvh" for n in ("01", "02", "13", "14", "15")], seconds=0.5)
    corpus = build_corpus("bodies", root=root, of="cmu-salsa", cache=False)
    check_separation(corpus, {"giant", "youth"})
    seen = {"own", *MADE_BODIES} - {"giant", "youth"}
    train = groups(corpus, "train")
    assert set(train) == {f"seen body ({body}), seen motion" for body in seen}
    assert len(set(train.values())) == 1
    tall = corpus.split("test", {"body": "giant"})[0]
    own = corpus.split("train", {"body": "own"})[0]
    assert_close(tall.offsets, 1.3 * own.offsets)


def test_the_folder_of_the_corpus_built_on_must_be_there(tmp_path: Path) -> None:
    for of in ("cmu-asf", "cmu-salsa"):
        with pytest.raises(DataError, match="no such folder"):
            build_corpus("bodies", root=tmp_path / "nowhere", of=of, cache=False)
        with pytest.raises(DataError, match="none of the"):
            build_corpus("bodies", root=tmp_path, of=of, cache=False)


def test_an_unseen_body_of_which_nothing_is_there_is_refused(write_amc: Write) -> None:
    root = write_amc(["01/01_01.amc", "02/02_01.amc"])
    with pytest.raises(DataError, match="bodies 01, 02 are there; expected 03, unseen"):
        build_corpus("bodies", root=root, of="cmu-asf", cache=False)
    with pytest.raises(DataError, match="and another"):
        build_corpus("bodies", root=root, of="cmu-asf", unseen=["01", "02"], cache=False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"of": "cmu-asff"}, "'cmu-asff' is not known; did you mean 'cmu-asf'"),
        ({"unseen": "tal"}, "'tal' is none of synthetic; did you mean 'tall'"),
        ({"unseen": [4], "of": "cmu-asf"}, "'04' is none of cmu-asf; did you mean"),
        ({"unseen": []}, "0 of the 8 bodies"),
        ({"unseen": [body.name for body in CAST]}, "8 of the 8 bodies"),
        ({"group_size": 0}, "group_size 0"),
        ({"of": "cmu-asf"}, "give root"),
        ({"of": "cmu-salsa", "clips": 12, "seed": 1}, "clips, seed cannot be chosen of cmu-salsa"),
        ({"group_sise": 1}, "did you mean 'group_size'"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        build_corpus("bodies", **options)  # type: ignore[arg-type]


@pytest.mark.data
def test_the_people_at_hand_have_bodies_of_their_own(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus("bodies", root=data_root / "cmu-asf", of="cmu-asf", cache=tmp_path)
    check_separation(corpus, set(UNSEEN["cmu-asf"]))
    assert [len(corpus.splits[split]) for split in corpus.splits] == [72, 2, 18]
    recorded = {
        clip.labels["file"]: clip
        for clip in build_corpus("cmu-asf", root=data_root / "cmu-asf", cache=tmp_path).clips
        if clip.labels["phase"] == "0"
    }
    for clip in corpus.split("test"):
        assert clip.source is None
        before = recorded[clip.labels["file"]]
        assert torch.equal(clip.rotations_local, before.rotations_local)
        world = [
            joint_positions(c.skeleton, c.rotations_local, c.offsets, c.root_positions)[..., 1]
            for c in (before, clip)
        ]
        # Their legs differ by 1 cm, the directions of their hips by 8 degrees.
        assert (world[1].amin(-1) - world[0].amin(-1)).abs().max() < 0.06
