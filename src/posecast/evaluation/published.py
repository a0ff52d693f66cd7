"""Published numbers, exactly as printed, and which of our systems they belong to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from posecast.evaluation.scores import AVERAGE, Milliseconds

# Our name of a system -> what the papers call it. A name that a paper uses for another system in
# another table must not be listed. Variants of ours, such as small ones, are not either: no number
# is theirs, though ``posecast reproduce --small`` prints what the paper has of the whole form.
PRINTED_NAMES: Mapping[str, tuple[str, ...]] = {
    "zero-velocity": (
        "Zero-velocity (Martinez et al., CVPR 2017)",
        "Zero-velocity",
        "Zero-velocity [32]",
        "Zero-Velocity [20]",
    ),
    "running-average-2": (
        "Run. avg. 2 (Martinez et al., CVPR 2017)",
        "Run. avg. 2",
        "Run. avg. 2 [32]",
    ),
    "running-average-4": (
        "Run. avg. 4 (Martinez et al., CVPR 2017)",
        "Run. avg. 4",
        "Run. avg. 4 [32]",
    ),
    "quaternet-abs": (
        "QuaterNet abs. (Pavlo et al., BMVC 2018b)",
        "QuaterNet abs.",
        "QuaterNet absolute",
    ),
    "quaternet-vel": (
        "QuaterNet vel. (Pavlo et al., BMVC 2018b)",
        "QuaterNet vel.",
        "QuaterNet velocity",
        "QuaterNet [25]",
        "QuaterNet short-term, quaternions",
    ),
    "quaternet-vel-tf": ("QuaterNet vel. TF",),
    "quaternet-cnn-abs": ("QuaterNet CNN abs.",),
    "quaternet-cnn-vel": ("QuaterNet CNN vel.",),
    "quaternet-cnn-vel-tf": ("QuaterNet CNN vel. TF",),
    "h36m-quaternet-spl": ("QuaterNet-SPL",),
    "h36m-seq2seq-sampling": (
        "GRU unsup. (Martinez et al., CVPR 2017)",
        "GRU unsup.",
        "GRU unsup. [32]",
        "Seq2seq-sampling [20]",
    ),
    "h36m-seq2seq-sampling-sup": (
        "GRU sup. (Martinez et al., CVPR 2017)",
        "GRU sup.",
        "GRU sup. [32]",
        "Seq2seq-sampling-sup [20]",
    ),
    "h36m-seq2seq-sampling-spl": ("Seq2seq-sampling-SPL",),
    "h36m-seq2seq-sampling-sup-spl": ("Seq2seq-sampling-sup-SPL",),
    "h36m-aged": ("Adversarial (Gui et al., ECCV 2018)", "AGED [33]"),
    "h36m-lstm-3lr": (
        "LSTM-3LR (Fragkiadaki et al., CVPR 2015)",
        "LSTM-3LR [12]",
        "LSTM-3LR [7]",
    ),
    "h36m-erd": ("ERD (Fragkiadaki et al., CVPR 2015)", "ERD [12]"),
    "h36m-srnn": ("SRNN (Jain et al., CVPR 2016)", "SRNN [29]", "SRNN [14]"),
    "h36m-rnn": ("RNN", "RNN-mean"),
    "h36m-rnn-pjl": ("RNN-PJL",),
    "h36m-rnn-spl": ("RNN-SPL",),
    "h36m-rnn-spl-indep": ("RNN-SPL-indep.",),
    "h36m-rnn-spl-random": ("RNN-SPL-random",),
    "h36m-rnn-spl-reverse": ("RNN-SPL-reverse",),
    "quaternet-dual-quaternion": ("QuaterNet short-term, dual quaternions",),
    # The acRNN systems of sca2022, Table 1, are not named: its recordings are probably those of
    # another subject than the ones at hand, so its numbers must not stand beside ours.
}

# QuaterNet's code counts all angles, that of Martinez et al. those that move in the window. For
# baselines the two are the same number; printed numbers stand beside both.
_SAME_IN_PRINT = {"euler_all": "euler"}

# Numbers of an early release of AMASS, which hold for no other: ``posecast reproduce`` prints them,
# but they do not stand beside what somebody measures on today's.
_NOT_BESIDE = frozenset({"amass-spl"})

# The same windows with other horizons: what is printed for one holds for the other.
_SAME_WINDOWS = {
    "h36m-standard": ("h36m-standard", "h36m-long"),
    "h36m-long": ("h36m-long", "h36m-standard"),
}


class Published(NamedTuple):
    """A printed number.

    Args:
        value: as printed.
        source: paper and table, as ``ijcv2019, Table 2``.
        digits: decimals that the table prints.
    """

    value: float
    source: str
    digits: int


class PublishedTable(NamedTuple):
    """A printed table, one metric of it.

    Args:
        source: paper and table, as ``ijcv2019, Table 2``.
        title: authors, title and year of the paper.
        protocol: name of the protocol, ours where we have it.
        metric: name of the metric, ours where we have it.
        span: ``at`` the horizon, or ``sum`` or ``mean`` over the frames up to it.
        unit: of the values.
        horizons_ms: horizons of the columns, milliseconds.
        systems: printed name -> action -> one value a horizon; ``average`` is over 15 actions,
            ``all`` stands for no actions at all.
    """

    source: str
    title: str
    protocol: str
    metric: str
    span: str
    unit: str
    horizons_ms: tuple[Milliseconds, ...]
    systems: Mapping[str, Mapping[str, tuple[float, ...]]]

    @property
    def digits(self) -> int:
        """Decimals of all its cells: as many as the one has that ends in no zero."""
        rows = (row for actions in self.systems.values() for row in actions.values())
        return max(len(f"{value:.6g}".partition(".")[2]) for row in rows for value in row)


@cache
def published_tables() -> tuple[PublishedTable, ...]:
    """All printed tables we know, in the order in which they are searched."""
    text = files("posecast.evaluation").joinpath("published.json").read_text(encoding="utf-8")
    content = json.loads(text)
    return tuple(
        PublishedTable(
            source=f"{table['paper']}, Table {table['table']}",
            title=content["papers"][table["paper"]],
            protocol=table["protocol"],
            metric=table["metric"],
            span=table["span"],
            unit=table["unit"],
            horizons_ms=tuple(table["horizons_ms"]),
            systems={
                system: {action: tuple(values) for action, values in actions.items()}
                for system, actions in table["systems"].items()
            },
        )
        for table in content["tables"]
    )


def find_published(
    system: str,
    protocol: str,
    *,
    action: str,
    metric: str,
    horizon_ms: Milliseconds,
    complete: bool = True,
) -> Published | None:
    """The printed number for a row, or ``None`` where there is none.

    Args:
        system: our name of the system.
        protocol: our name of the protocol.
        action: action, or ``average``.
        metric: name in ``METRICS``.
        horizon_ms: milliseconds.
        complete: whether our average is over all the actions of the protocol; an average over
            fewer has no published counterpart.
    """
    if protocol in _NOT_BESIDE or (action == AVERAGE and not complete):
        return None
    names = PRINTED_NAMES.get(system, ())
    protocols = _SAME_WINDOWS.get(protocol, (protocol,))
    tables = [
        table
        for wanted in protocols
        for table in published_tables()
        if (table.protocol, table.metric) == (wanted, _SAME_IN_PRINT.get(metric, metric))
        and horizon_ms in table.horizons_ms
    ]
    for table in tables:
        for name in names:
            if action in table.systems.get(name, {}):
                column = table.horizons_ms.index(horizon_ms)
                return Published(table.systems[name][action][column], table.source, table.digits)
    return None
