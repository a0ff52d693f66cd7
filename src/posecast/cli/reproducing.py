"""What ``posecast reproduce`` does: a table of a paper, its numbers and ours side by side."""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from posecast.cli.compared import Contestant, spread
from posecast.cli.comparing import contest, write
from posecast.cli.terminal import progress_bar, say
from posecast.corpora import CORPORA
from posecast.errors import ConfigError
from posecast.evaluation import (
    BASELINE_NAMES,
    METRICS,
    Predictor,
    Protocol,
    Scores,
    build_protocol,
    keypoint_curve,
    make_baseline,
)
from posecast.evaluation.published import PublishedTable
from posecast.evaluation.report import markdown_rows
from posecast.evaluation.reproduced import (
    PrintedTable,
    choose_rows,
    printed_table,
    printed_tables,
)
from posecast.evaluation.scores import AVERAGE
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, load_recipe
from posecast.recipe.files import SMALL


@dataclass(frozen=True, eq=False)
class Found:
    """What was measured of one row.

    Args:
        printed: name of the row in the paper.
        system: name of our recipe or baseline.
        runs: scores, one a seed.
        predictor: the system, with the first seed.
        parameters: trained values; ``None`` for baselines.
        seconds: of training, one a seed.
    """

    printed: str
    system: str
    runs: tuple[Scores, ...]
    predictor: Predictor
    parameters: int | None = None
    seconds: tuple[float, ...] = ()


def list_tables() -> str:
    """All tables, and what stands for each of their rows here."""
    blocks: list[str] = []
    for name, table in printed_tables().items():
        rows = [f"  {row}: {system}" for row, system in table.rows.items()]
        blocks.append("\n".join([f"{name} ({table.protocol}): {table.title}", *rows]))
    return "\n\n".join(blocks)


def reproduce_table(
    name: str,
    wanted: Sequence[str],
    overrides: Sequence[str],
    out: Path,
    *,
    roots: Mapping[str, Path],
    corpus: str | None,
    seeds: int,
    small: bool,
    progress: bool = True,
) -> str:
    """Train and score what a table needs; write ``TABLE.md`` and ``TABLE.json`` into ``out``.

    With ``TABLE.png``, a curve of correct joints a system, where positions are in thighs.

    It may be stopped at any moment; the same call goes on. Runs are in ``out/RECIPE/SEED``.

    Args:
        name: of the table, see ``list_tables``.
        wanted: rows by the paper's names or ours; none: all.
        overrides: of every recipe.
        out: folder.
        roots: folders of corpora, by kind.
        corpus: kind of corpus in the place of the recipes'.
        seeds: runs of each recipe, with the seeds 0, 1, ...
        small: take the small forms of the recipes.
        progress: show how far training is, on standard error.

    Returns:
        The report, in Markdown.

    Raises:
        ConfigError: no such table or row, or nothing can be done as data are missing; nothing is
            trained then.
    """
    if seeds < 1:
        raise ConfigError(f"--seeds {seeds}: expected 1 or more")
    if any(each.partition("=")[0].strip() in ("name", "training.seed") for each in overrides):
        raise ConfigError("name and training.seed tell the runs apart; leave them out")
    table = printed_table(name)
    rows = choose_rows(table, wanted)
    recipes = {
        row: [
            load_recipe(
                f"{system}{SMALL}" if small else system,
                [*overrides, f"training.seed={seed}"],
                corpus=corpus,
            )
            for seed in range(seeds)
        ]
        for row, system in rows.items()
        if system not in BASELINE_NAMES
    }
    ready = {row: runs for row, runs in recipes.items() if _has_data(runs[0], roots)}
    absent = {row: _kind(runs[0]) for row, runs in recipes.items() if row not in ready}
    if not ready:
        kinds = sorted(set(absent.values())) or ["(baselines alone: name a row to train)"]
        raise ConfigError(
            f"{name}: no row has its data; give " + ", ".join(f"--root {k}=DIR" for k in kinds)
        )
    data = _read(ready.values(), roots)
    for runs in ready.values():
        _protocol(table, runs[0]).windows(data[_key(runs[0])])
    found = [_train(row, runs, table, data, out, progress) for row, runs in ready.items()]
    first = next(iter(ready.values()))[0]
    for row, system in rows.items():
        if system in BASELINE_NAMES:
            corpus_read, protocol = data[_key(first)], _protocol(table, first)
            baseline = make_baseline(system, corpus_read)
            scores = protocol.score(baseline, corpus_read, system=system)
            found.insert(0, Found(row, system, (scores,), baseline))
    _draw(found, _protocol(table, first), data[_key(first)], out / f"{name}.png")
    text = _to_markdown(table, found, absent, ready, data)
    write(out / f"{name}.md", text)
    write(out / f"{name}.json", json.dumps(_to_json(table, found), indent=1) + "\n")
    return text


def _kind(recipe: Recipe) -> str:
    return str(recipe.config["corpus"]["kind"])


def _has_data(recipe: Recipe, roots: Mapping[str, Path]) -> bool:
    """Whether the recordings of a recipe are there, or it needs none."""
    return _kind(recipe) in roots or _kind(recipe) == "synthetic"


def _key(recipe: Recipe) -> str:
    """Recipes with one key read the same corpus."""
    return json.dumps([recipe.config["corpus"], recipe.fps], sort_keys=True)


def _read(recipes: Any, roots: Mapping[str, Path]) -> dict[str, Corpus]:
    """Every corpus once."""
    data: dict[str, Corpus] = {}
    for runs in recipes:
        recipe = runs[0]
        if _key(recipe) not in data:
            with progress_bar(f"reading {_kind(recipe)}") as advance:
                data[_key(recipe)] = recipe.build_corpus(roots.get(_kind(recipe)), progress=advance)
    return data


def _protocol(table: PrintedTable, recipe: Recipe) -> Protocol:
    """That of the table with its horizons; the recipe's own where that is another."""
    if recipe.protocol.name != table.protocol:
        return recipe.protocol
    options = {**recipe.config["protocol"], "horizons_ms": list(table.horizons_ms)}
    return build_protocol(**options)


def _train(
    row: str,
    runs: Sequence[Recipe],
    table: PrintedTable,
    data: Mapping[str, Corpus],
    out: Path,
    progress: bool,
) -> Found:
    """All seeds of a row."""
    corpus = data[_key(runs[0])]
    done: Contestant = contest(runs, corpus, _protocol(table, runs[0]), out, progress=progress)
    return Found(
        row,
        runs[0].name,
        done.report.runs,
        done.runs[0].predictor,
        done.cost.parameters,
        tuple(done.cost.seconds),
    )


def _to_markdown(
    table: PrintedTable,
    found: Sequence[Found],
    absent: Mapping[str, str],
    ready: Mapping[str, Sequence[Recipe]],
    data: Mapping[str, Corpus],
) -> str:
    """What was done, a table of costs, then one a metric with the paper's numbers above ours."""
    plans = {runs[0].name: runs[0].plan for runs in ready.values()}
    corpora = sorted({corpus.name for corpus in data.values()})
    scores = found[-1].runs[0]
    same = scores.protocol == table.protocol
    blocks = [
        f"# {table.name}: {table.title}",
        f"Ours: corpus {', '.join(corpora)}, protocol {scores.protocol}; mean ± standard deviation "
        "over seeds. "
        + (
            ""
            if same
            else f"The paper's protocol is {table.protocol}: its numbers are of other "
            "data and say nothing of ours."
        ),
        markdown_rows(_costs(found, plans)),
    ]
    for part in table.parts:
        if same and part.metric in scores.metrics:
            blocks.append(_part(part, found))
    if not same:
        blocks += [_own(metric, found) for metric in scores.metrics]
    notes = [
        f"Left out as its recordings are missing: {row} (--root {kind}=DIR)."
        for row, kind in absent.items()
    ]
    notes += [*scores.notes, *(note for corpus in data.values() for note in corpus.notes)]
    blocks.append("\n".join(f"- {note}" for note in dict.fromkeys(notes)))
    return "\n\n".join(block for block in blocks if block) + "\n"


def _costs(found: Sequence[Found], plans: Mapping[str, Any]) -> list[list[str]]:
    """Rows of what each system is and took."""
    rows = [
        ["row", "system", "parameters", "epochs", "seeds", "training (s)"],
        ["---", "---", "---:", "---:", "---:", "---:"],
    ]
    for each in found:
        if each.parameters is not None:
            rows.append(
                [
                    each.printed,
                    each.system,
                    f"{each.parameters:,}",
                    str(plans[each.system].epochs),
                    str(len(each.runs)),
                    spread(each.seconds),
                ]
            )
    return rows


def _part(part: PublishedTable, found: Sequence[Found]) -> str:
    """One metric: of every action and system what the paper prints, and what was measured."""
    metric = METRICS[part.metric]
    columns = [f"{horizon:g} ms" for horizon in part.horizons_ms]
    rows = [
        ["action", "system", "whose", *columns],
        ["---", "---", "---", *["---:" for _ in columns]],
    ]
    measured = found[-1].runs[0].actions
    for action in (*measured, *((AVERAGE,) if len(measured) > 1 else ())):
        for each in found:
            paper = _paper(part, each.printed, action, measured)
            own = _ours(each, part.metric, action, part.horizons_ms)
            label = action if action != AVERAGE else f"average of {len(measured)}"
            digits = metric.digits
            if paper is not None:
                rows.append([label, each.printed, "paper", *(f"{v:g}" for v in paper)])
            rows.append([label, each.system, "ours", *(spread(v, digits) for v in own)])
    return f"**{metric.title} ({metric.unit})**: `{part.metric}`\n\n{markdown_rows(rows)}"


def _own(name: str, found: Sequence[Found]) -> str:
    """One metric of ours alone."""
    metric, horizons = METRICS[name], found[-1].runs[0].horizons_ms
    columns = [f"{horizon:g} ms" for horizon in horizons]
    rows = [["system", *columns], ["---", *["---:" for _ in columns]]]
    for each in found:
        values = _ours(each, name, AVERAGE, horizons)
        rows.append([each.system, *(spread(value, metric.digits) for value in values)])
    return f"**{metric.title} ({metric.unit})**: `{name}`\n\n{markdown_rows(rows)}"


def _paper(
    part: PublishedTable, printed: str, action: str, measured: Sequence[str]
) -> tuple[float, ...] | None:
    """What the paper prints; its average is taken over the actions that were measured."""
    actions = part.systems.get(printed, {})
    if action != AVERAGE:
        return actions.get(action)
    if not all(each in actions for each in measured):
        return None
    columns = zip(*(actions[each] for each in measured), strict=True)
    return tuple(round(statistics.fmean(column), 3) for column in columns)


def _ours(
    found: Found, metric: str, action: str, horizons: Sequence[int | float]
) -> list[tuple[float, ...]]:
    """For each horizon the values of all seeds."""
    return [tuple(run.value(metric, horizon, action) for run in found.runs) for horizon in horizons]


def _to_json(table: PrintedTable, found: Sequence[Found]) -> dict[str, Any]:
    """All numbers by name, those of every seed included."""
    return {
        "table": table.name,
        "title": table.title,
        "protocol": table.protocol,
        "rows": [
            {
                "row": each.printed,
                "system": each.system,
                "parameters": each.parameters,
                "training_seconds": list(each.seconds),
                "seeds": [[row._asdict() for row in run.rows] for run in each.runs],
                "paper": {
                    part.metric: {
                        action: list(values)
                        for action, values in part.systems.get(each.printed, {}).items()
                    }
                    for part in table.parts
                },
            }
            for each in found
        ],
    }


def parse_roots(given: Sequence[str]) -> dict[str, Path]:
    """``["h36m=data/h36m"]`` as folders by kind of corpus.

    Raises:
        ConfigError: no ``=``, an unknown kind, or a folder that is none.
    """
    roots: dict[str, Path] = {}
    for each in given:
        kind, equals, folder = each.partition("=")
        if not equals or kind not in CORPORA:
            raise ConfigError(
                f"--root {each}: expected KIND=DIR with a corpus among {', '.join(CORPORA)}"
            )
        if not Path(folder).is_dir():
            raise ConfigError(f"--root {each}: {folder} is not a folder")
        roots[kind] = Path(folder)
    return roots


def _draw(found: Sequence[Found], protocol: Protocol, corpus: Corpus, path: Path) -> None:
    """How many joints are within which distance until the last horizon, where thighs are known."""
    if not any("thigh" in METRICS[metric].asks for metric in protocol.metrics):
        return
    from posecast.viewer.plots import lines

    until = protocol.horizons_ms[-1]
    lines(
        {
            each.system: keypoint_curve(each.predictor, protocol, corpus, horizon_ms=until)
            for each in found
        },
        path,
        across="threshold (thighs)",
        upright="share of joints within it (PCK)",
        title=f"Correct joints until {until:g} ms, {protocol.name} on {corpus.name}",
    )
    say(f"{path} written")
