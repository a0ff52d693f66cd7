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
    caveat,
    choose_rows,
    printed_table,
    printed_tables,
    small_form,
)
from posecast.evaluation.scores import AVERAGE
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, load_recipe


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

    def load(system: str, seed: int) -> Recipe:
        return _load(system, [*overrides, f"training.seed={seed}"], roots, corpus, small=small)

    trained = [row for row, system in rows.items() if system not in BASELINE_NAMES]
    recipes = {row: [load(rows[row], seed) for seed in range(seeds)] for row in trained}
    # Baselines are scored as the systems beside them, or as the table's first would be.
    beside = next(system for system in table.rows.values() if system not in BASELINE_NAMES)
    first = recipes[trained[0]][0] if trained else load(beside, 0)
    absent = {row: _kind(runs[0]) for row, runs in recipes.items() if not _has_data(runs[0], roots)}
    if len(absent) == len(trained) and not _has_data(first, roots):
        kinds = table.corpora if corpus is None else (corpus,)
        raise ConfigError(
            f"{name}: no row has its data; give " + " or ".join(f"--root {k}=DIR" for k in kinds)
        )
    ready = {row: runs for row, runs in recipes.items() if row not in absent}
    first = next(iter(ready.values()))[0] if ready else first
    keys = {each.partition("=")[0].strip() for each in overrides} - {"protocol.metrics"}
    own = any(key.split(".")[0] == "protocol" for key in keys)
    protocol = _one_protocol(table, first, ready, own=own)
    data = _read([[first], *ready.values()], roots)
    for each in data.values():
        protocol.windows(each)
    found: list[Found] = []
    for row, system in rows.items():
        if row in ready:
            runs = ready[row]
            found.append(_train(row, runs, protocol, data[_key(runs[0])], out, progress))
        elif system in BASELINE_NAMES:
            baseline = make_baseline(system, data[_key(first)])
            scores = protocol.score(baseline, data[_key(first)], system=system)
            found.append(Found(row, system, (scores,), baseline))
    out.mkdir(parents=True, exist_ok=True)  # baselines alone leave no runs there
    _draw(found, protocol, data[_key(first)], out / f"{name}.png")
    comparable = not own and _kind(first) in table.corpora
    text = _to_markdown(table, found, absent, ready, data, comparable=comparable)
    write(out / f"{name}.md", text)
    write(out / f"{name}.json", json.dumps(_to_json(table, found, comparable), indent=1) + "\n")
    return text


def _load(
    system: str,
    overrides: Sequence[str],
    roots: Mapping[str, Path],
    corpus: str | None,
    *,
    small: bool,
) -> Recipe:
    """A recipe, on the first release of AMASS if that is what there is of AMASS."""
    name = small_form(system) if small else system
    if corpus is None and "amass-first" in roots and "amass" not in roots:
        given = load_recipe(name, overrides)
        corpus = "amass-first" if _kind(given) == "amass" else None
    return load_recipe(name, overrides, corpus=corpus)


def _one_protocol(
    table: PrintedTable, first: Recipe, ready: Mapping[str, Sequence[Recipe]], *, own: bool
) -> Protocol:
    """The table's protocol, or that which somebody gave or a corpus of another kind needs.

    Raises:
        ConfigError: rows would be scored under different ones, or on different corpora.
    """
    made = {row: _protocol(table, runs[0], own=own) for row, runs in ready.items()}
    chosen = _protocol(table, first, own=own)
    for row, runs in ready.items():
        alike = repr(made[row]) == repr(chosen) and _kind(runs[0]) == _kind(first)
        if not alike or runs[0].fps != first.fps:
            raise ConfigError(
                f"{table.name}: rows {next(iter(ready))!r} and {row!r} would be scored under "
                "different protocols or on different corpora; give the same corpus and "
                "protocol={kind: ..., ...} for all, or do them one by one"
            )
    return chosen


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


def _protocol(table: PrintedTable, recipe: Recipe, *, own: bool) -> Protocol:
    """That of the table with its horizons; the recipe's where that is wanted or must be."""
    if own or _kind(recipe) not in table.corpora:
        return recipe.protocol
    options = dict(recipe.config["protocol"])
    if options["kind"] != table.protocol:
        options = {"kind": table.protocol}
    return build_protocol(**{**options, "horizons_ms": list(table.horizons_ms)})


def _train(
    row: str,
    runs: Sequence[Recipe],
    protocol: Protocol,
    corpus: Corpus,
    out: Path,
    progress: bool,
) -> Found:
    """All seeds of a row."""
    done: Contestant = contest(runs, corpus, protocol, out, progress=progress)
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
    *,
    comparable: bool,
) -> str:
    """What was done, a table of costs, then one a metric with the paper's numbers above ours."""
    plans = {runs[0].name: runs[0].plan for runs in ready.values()}
    corpora = sorted({corpus.name for corpus in data.values()})
    scores = found[-1].runs[0]
    known = [note for corpus in data.values() if (note := caveat(corpus.name))]
    lead = [
        f"Ours: corpus {', '.join(corpora)}, protocol {scores.protocol}; mean ± standard deviation "
        "over seeds.",
        *(known if comparable else [_unlike(table, scores, corpora)]),
    ]
    blocks = [f"# {table.name}: {table.title}", " ".join(lead)]
    if any(each.parameters is not None for each in found):
        blocks.append(markdown_rows(_costs(found, plans)))
    if comparable:
        measured = [part for part in table.parts if part.metric in scores.metrics]
        blocks += [_part(part, found) for part in measured]
    else:
        blocks += [_own(metric, found) for metric in scores.metrics]
    notes = [
        f"Left out as its recordings are missing: {row} (--root {kind}=DIR)."
        for row, kind in absent.items()
    ]
    notes += [*scores.notes, *(note for corpus in data.values() for note in corpus.notes)]
    blocks.append("\n".join(f"- {note}" for note in dict.fromkeys(notes)))
    return "\n\n".join(block for block in blocks if block) + "\n"


def _unlike(table: PrintedTable, scores: Scores, corpora: Sequence[str]) -> str:
    """Why the paper's numbers are left out."""
    if scores.protocol != table.protocol:
        what = f"protocol is {table.protocol}"
    elif set(corpora) <= set(table.corpora):
        what = f"{table.protocol} has other options"
    else:
        what = f"recordings are not those of {', '.join(corpora)}"
    return f"The paper's {what}: its numbers say nothing of ours, and are left out."


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


def _to_json(table: PrintedTable, found: Sequence[Found], comparable: bool) -> dict[str, Any]:
    """All numbers by name, those of every seed included."""
    return {
        "table": table.name,
        "title": table.title,
        "protocol": table.protocol,
        "comparable": comparable,
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
