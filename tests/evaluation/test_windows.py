"""The windows of the published protocols, against vectors and tables printed elsewhere."""

from __future__ import annotations

import itertools

import pytest

from posecast.errors import ConfigError, DataError
from posecast.evaluation import build_protocol
from posecast.evaluation.windows import (
    H36M_ACTIONS,
    Grid,
    LegacyDraws,
    grid_starts,
    legacy_starts,
)
from posecast.motion.corpus import Corpus, Window

# 16 draws with low = 16 and this exclusive upper bound, from the generator that the code of
# Martinez et al. seeds with 1234567890.
VECTORS = {
    1000: [402, 374, 63, 156, 835, 305, 955, 121, 332, 414, 665, 660, 572, 304, 778, 201],
    2000: [
        *(1426, 1398, 1087, 1180, 1859, 1329, 955, 1145),
        *(332, 1438, 1689, 660, 1596, 304, 1802, 201),
    ],
}

# Start indices of recording 1 and 2, and lengths of the recordings for which the draws give
# exactly these: lowest and highest of recording 1, then of recording 2.
TABLE = {
    "walking": ([1087, 1145, 660, 201], [955, 332, 304, 54], (1296, 1548), (1191, 1330)),
    "eating": ([1426, 1087, 1329, 1145], [374, 156, 955, 332], (1577, 2009), (1106, 1189)),
    "smoking": ([1426, 1087, 1329, 1145], [1398, 1180, 955, 332], (1577, 2009), (1549, 2213)),
    "discussion": ([1426, 1398, 1180, 332], [2063, 1087, 1145, 1438], (1577, 4262), (2215, 3153)),
    "directions": ([1426, 1087, 1145, 1438], [374, 156, 332, 665], (2215, 3153), (816, 1189)),
    "greeting": ([402, 63, 305, 121], [1398, 1180, 955, 332], (679, 985), (1549, 2213)),
    "phoning": ([1426, 1087, 1329, 332], [374, 156, 121, 414], (1577, 2009), (565, 1105)),
    "posing": ([402, 63, 835, 955], [374, 156, 305, 121], (1106, 1190), (525, 1189)),
    "purchases": ([1087, 955, 332, 304], [1180, 1145, 660, 201], (1238, 1479), (1331, 1588)),
    "sitting": ([1426, 1087, 1329, 1145], [1398, 1180, 955, 332], (1577, 2009), (1549, 2213)),
    "sittingdown": ([1426, 1087, 1145, 1438], [1398, 1180, 332, 1689], (2215, 3153), (1840, 2213)),
    "takingphoto": ([1426, 1180, 1145, 1438], [1087, 955, 332, 660], (1589, 4262), (1238, 1479)),
    "waiting": ([1426, 1398, 1180, 332], [2063, 1087, 1145, 1438], (1577, 4262), (2215, 3153)),
    "walkingdog": ([402, 63, 305, 332], [374, 156, 121, 414], (679, 985), (565, 1105)),
    "walkingtogether": ([1087, 1329, 1145, 660], [1180, 955, 332, 304], (1480, 1548), (1331, 1746)),
}


@pytest.mark.parametrize("high", VECTORS)
def test_the_draws_are_those_of_the_legacy_generator(high):
    starts = [start for _, start in legacy_starts((high + 150, high + 150), 8)]
    assert starts == VECTORS[high]


def test_the_table_of_starts_covers_all_fifteen_actions():
    assert len(H36M_ACTIONS) == 15
    assert tuple(TABLE) == H36M_ACTIONS


@pytest.mark.parametrize("action", TABLE)
def test_the_starts_of_an_action_are_the_published_ones(action):
    first, second, first_range, second_range = TABLE[action]
    expected = [place for pair in zip(first, second, strict=True) for place in enumerate(pair)]
    for frames in itertools.product(first_range, second_range):
        assert list(legacy_starts(frames, 4)) == expected, frames


def test_recordings_alternate_and_more_pairs_extend_the_same_sequence():
    few, many = legacy_starts((1500, 1260), 4), legacy_starts((1500, 1260), 128)
    assert (len(few), len(many)) == (8, 256)
    assert many[:8] == few
    assert [recording for recording, _ in many] == [0, 1] * 128
    assert min(start for _, start in many) >= 16
    assert all(start < (1350, 1110)[recording] for recording, start in many)


@pytest.mark.parametrize(("pairs", "windows"), [(4, 8), (128, 256)])
def test_every_action_has_as_many_windows_as_its_protocol_says(make_h36m, pairs, windows):
    corpus = make_h36m(("walking", "eating"))
    sampling = LegacyDraws(pairs).sample(corpus, "test", 60)
    assert [(group.name, len(group.windows)) for group in sampling.groups] == [
        ("walking", windows),
        ("eating", windows),
    ]
    assert [window.clip for window in sampling.groups[1].windows[:4]] == [2, 3, 2, 3]
    assert sampling.expected == 15
    assert len(sampling.missing) == 26
    assert sampling.missing[0] == "S5/smoking_1.txt"


def test_an_action_without_one_recording_is_left_out_and_its_file_named(make_h36m):
    whole = make_h36m(("walking", "eating"))
    corpus = Corpus("toy", whole.clips, {"test": (0, 1, 2)})
    sampling = LegacyDraws(4, actions=("walking", "eating")).sample(corpus, "test", 60)
    assert [group.name for group in sampling.groups] == ["walking"]
    assert sampling.missing == ("S5/eating_2.txt",)
    assert any("eating" in note for note in sampling.notes)


def test_windows_too_long_for_the_draws_are_refused(make_h36m):
    with pytest.raises(ConfigError, match="keep only 150"):
        LegacyDraws(4).sample(make_h36m(("walking",)), "test", 151)


def test_two_phases_of_one_recording_are_refused(make_h36m):
    clips = make_h36m(("walking",)).clips
    corpus = Corpus("toy", [*clips, clips[0]], {"test": (0, 1, 2)})
    with pytest.raises(ConfigError, match="more than once"):
        LegacyDraws(4).sample(corpus, "test", 60)


def test_a_corpus_without_actions_is_told_which_protocol_would_do(make_clip):
    corpus = Corpus("toy", [make_clip(400, 0)], {"test": (0,)})
    with pytest.raises(ConfigError, match="use protocol 'short-term'"):
        LegacyDraws(4).sample(corpus, "test", 60)


def test_a_recording_too_short_to_draw_from_is_refused(make_clip):
    clips = [
        make_clip(frames, 0, action="walking", recording=str(recording))
        for recording, frames in ((1, 400), (2, 166))
    ]
    with pytest.raises(DataError, match="166 frames at 25 fps"):
        LegacyDraws(4).sample(Corpus("toy", clips, {"test": (0, 1)}), "test", 60)


@pytest.mark.parametrize(
    ("frames", "starts"), [(59, []), (60, [0]), (69, [0]), (70, [0, 10]), (85, [0, 10, 20])]
)
def test_a_grid_holds_exactly_the_windows_that_fit(frames, starts):
    assert list(grid_starts(frames, 60, 10)) == starts


def test_a_grid_groups_by_label_and_names_clips_that_are_too_short(make_clip):
    clips = [
        make_clip(80, 0, action="walk"),
        make_clip(59, 1, action="jog"),
        make_clip(60, 2, action="run"),
        make_clip(61, 3),
    ]
    sampling = Grid(10).sample(Corpus("toy", clips, {"test": (0, 1, 2, 3)}), "test", 60)
    assert {group.name: list(group.windows) for group in sampling.groups} == {
        "all": [Window(3, 0)],
        "run": [Window(2, 0)],
        "walk": [Window(0, 0), Window(0, 10), Window(0, 20)],
    }
    assert any("5 windows of 60 frames" in note for note in sampling.notes)
    assert any("shorter than a window: jog" in note for note in sampling.notes)


def test_a_grid_on_clips_that_are_all_too_short_is_refused(make_clip):
    corpus = Corpus("toy", [make_clip(59, 0)], {"test": (0,)})
    with pytest.raises(ConfigError, match="none of its 1 clips"):
        Grid(10).sample(corpus, "test", 60)


def test_an_unknown_split_is_refused(make_clip):
    corpus = Corpus("toy", [make_clip(80, 0)], {"test": (0,)})
    with pytest.raises(ConfigError, match="no split 'tset'"):
        Grid(10).sample(corpus, "tset", 60)


def test_an_empty_split_is_called_that(make_clip):
    corpus = Corpus("few", [make_clip(200, 0)], {"train": (0,), "test": ()})
    with pytest.raises(ConfigError, match="split 'test' of corpus 'few' is empty; it needs more"):
        Grid(stride=5).sample(corpus, "test", 60)


def test_a_limit_spreads_windows_evenly(make_clip):
    corpus = Corpus("toy", [make_clip(300, 1, action="walk")], {"test": (0,)})
    whole = Grid(7).sample(corpus, "test", 40).groups[0].windows
    few = Grid(7, limit=4).sample(corpus, "test", 40)
    starts = [window.start for window in few.groups[0].windows]
    assert (len(whole), len(starts)) == (38, 4)
    assert starts == [whole[place].start for place in (0, 12, 25, 37)]
    assert any("Of the 38 windows of 'walk', 4 spread evenly" in note for note in few.notes)


def test_without_a_label_to_group_by_all_clips_are_one_group(make_clip):
    clips = [make_clip(100, 1, action="walk"), make_clip(100, 2, action="jog")]
    sampling = Grid(20, None).sample(Corpus("toy", clips, {"test": (0, 1)}), "test", 60)
    assert [(group.name, len(group.windows)) for group in sampling.groups] == [("all", 6)]


@pytest.mark.parametrize(("seconds", "windows"), [(20, 42), (160, 400)])
def test_the_windows_of_the_acrnn_protocol_are_every_seventh_and_at_most_400(
    make_clip, seconds, windows
):
    clip = make_clip(30 * seconds, 1, fps=30.0, action="salsa")
    sampling = build_protocol("cmu-acrnn").windows(Corpus("toy", [clip], {"test": (0,)}))
    (group,) = sampling.groups
    assert (group.name, len(group.windows)) == ("all", windows)
    starts = [window.start for window in group.windows]
    assert starts[0] == 0
    assert starts[-1] == (30 * seconds - 310) // 7 * 7
    assert all(start % 7 == 0 for start in starts)
    assert len(set(starts)) == windows
    assert any("Of the 642 windows of 'all', 400" in note for note in sampling.notes) == (
        windows == 400
    )


def test_scenarios_are_the_lines_of_the_cross_skeleton_table(make_clip):
    names = ("seen body, unseen motion", "unseen body, seen motion")
    clips = [make_clip(60, seed, fps=30.0, scenario=name) for seed, name in enumerate(names)]
    protocol = build_protocol("cross-skeleton")
    sampling = protocol.windows(Corpus("toy", clips, {"test": (0, 1)}))
    assert [group.name for group in sampling.groups] == list(names)
    # 60 frames hold windows of 10 + 30 that begin at 0, 7 and 14.
    assert [len(group.windows) for group in sampling.groups] == [3, 3]
    assert protocol.frames(60.0) == (20, (6, 24, 60))
    assert build_protocol("cross-skeleton", prefix_ms=400, horizons_ms=[80]).frames(25.0) == (
        10,
        (2,),
    )
