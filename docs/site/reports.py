"""The large pages that commands write (boards, proof, recordings, reproduction), and a short page before each.

They are made from the committed records. That of the reproduction takes minutes: it is shown where ``make docs`` or
``cablebench reproduce --out build/reproduction`` has left it.
"""

import json
import re
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from cable_envs.core.files import read_json
from docs.site.cache import ROOT, kept
from docs.site.markdown import page, table

if TYPE_CHECKING:
    from cablebench.board.tables import Board
    from cablebench.run.store import Reading, ResultStore

FOLDER = "reports"
BOARDS = ("suite-v1", "quick")
"""Published boards: the suite's, then those of the archive."""
PROOF, RECORDINGS = ROOT / "docs" / "proof", ROOT / "docs" / "recordings"
REPRODUCTION = ROOT / "build" / "reproduction"
DOCUMENT = re.compile(rb'href="(?:\.\./)*docs/([\w/-]+)\.md')
"""A link to a page of ``docs/``, from wherever the large page lies in the checkout."""
SHOWN = 6
"""Entrants of each table of the short page of boards."""


def pages() -> dict[str, str | bytes]:
    """All of them."""
    made: dict[str, str | bytes] = {"boards.md": _boards()}
    for name in BOARDS:
        folder = ROOT / "boards" / name
        whole = kept(f"board-{name}.json", partial(board_pages, name), sorted(p for p in folder.glob("*.*")))
        for address, text in json.loads(whole).items():
            place = f"{FOLDER}/board-{name}/{address}"
            made[place] = _with_way_back(text.encode(), "boards.html", "Boards", place.count("/"))
    proof = kept("proof.html", _proof_page, [PROOF / "proof.json.xz"])
    made[f"{FOLDER}/proof.html"] = _with_way_back(proof, "proof/proof.html", "Proof")
    made["proof/proof.md"] = kept("proof.md", _proof_rows, [PROOF / "proof.json.xz"]).decode()
    inputs = sorted([*RECORDINGS.glob("*.json.xz"), *(RECORDINGS / "figures").glob("*.svg")])
    recordings = kept("recordings.html", _recordings_page, inputs)
    made[f"{FOLDER}/recordings.html"] = _with_way_back(recordings, "recordings/index.html", "Recordings")
    made["reproduction.md"] = _reproduction()
    if (REPRODUCTION / "index.html").is_file():
        whole = (REPRODUCTION / "index.html").read_bytes()
        made[f"{FOLDER}/reproduction.html"] = _with_way_back(whole, "reproduction.html", "Reproduction")
    return made


def link_to(name: str, words: str, up: int = 0) -> str:
    """A link to one of the large pages, from a page ``up`` folders deep."""
    return f'<p class="report"><a href="{"../" * up}{FOLDER}/{name}.html">{words}</a></p>'


def _with_way_back(whole: bytes, address: str, title: str, depth: int = 1) -> bytes:
    """The page, ``depth`` folders deep, with a line at its top that leads to the site, and the site's icon.

    Links to files of ``docs/``, as the notes of a board have them, lead to the pages of the site.
    """
    top = "../" * depth
    whole = DOCUMENT.sub(rb'href="%s\1.html' % top.encode(), whole)
    icon = f'<link rel="icon" href="{top}assets/images/favicon.png">\n</head>'
    way = f'<a href="{top}index.html">cable-envs</a> / <a href="{top}{address}">{title}</a>'
    line = f'<header>\n<p class="soft">{way}</p>'
    return whole.replace(b"<header>", line.encode(), 1).replace(b"</head>", icon.encode(), 1)


@cache
def _board(name: str) -> "tuple[Board, ResultStore, Reading]":
    """A published board, its store, and its records."""
    from cablebench.board.board import build_board
    from cablebench.board.notes import REMARKS
    from cablebench.protocol.files import load_protocol
    from cablebench.run.folders import open_store

    folder = ROOT / "boards" / name
    store = open_store(folder)
    reading = store.read(False)
    remarks = (folder / REMARKS).read_text(encoding="utf-8")
    board = build_board(load_protocol(name), reading.records, remarks, f"--board {name}", reading.remark)
    return board, store, reading


def board_pages(name: str) -> bytes:
    """The pages of a published board, its tasks' too, as JSON: where they lie among each other -> HTML."""
    from cablebench.board.learning import learning_curves
    from cablebench.board.pages.task import board_pages as rendered
    from cablebench.run.makers import told_apart

    board, store, reading = _board(name)
    own = told_apart(r for r in reading.records if r["protocol_hash"] == board.protocol.hash())
    return json.dumps(dict(rendered(board, store.trajectories.of, learning_curves(store.places, own)))).encode()


def _boards() -> str:
    parts = [
        "# Boards",
        "The published boards rank reference controllers and trained agents on test episodes that nobody trained on. "
        "How to read one is on [its own page](read-the-board.md); how to enter, under "
        "[add your controller](add-your-controller.md) and [train your agent](train-your-agent.md). The board quick "
        "is of [suite v0](archive-v0.md), an archive.",
    ]
    for name in BOARDS:
        summary = kept(f"board-{name}-summary.md", partial(_summary, name), _records(name))
        parts += [summary.decode(), link_to(f"board-{name}/board", f"The {name} board, with a page for each task")]
    return page(*parts)


def _records(name: str) -> list[Path]:
    return [ROOT / "boards" / name / "records.jsonl.xz", ROOT / "boards" / name / "NOTES.md"]


def _summary(name: str) -> bytes:
    """The board's tables over all tasks of a mechanism, or its single tasks where it has no such table."""
    from cablebench.board.cells import cells, heading

    board = _board(name)[0]
    parts = [f"## {board.protocol.title}"]
    for shown in board.overall or board.tables:
        head, body = cells(shown)
        columns = [k for k, word in enumerate(head) if word in ("#", "controller", "class") or k <= 4]
        rows = [[line[k] for k in columns] for line in body[: 2 * SHOWN]]
        parts += [f"### {heading(shown)}", table([head[k] for k in columns], rows)]
    return page(*parts).encode()


def _proof_page() -> bytes:
    from cablebench.pages.proof import render

    return render(read_json(PROOF / "proof.json.xz")).encode()


def _proof_rows() -> bytes:
    """The page that the proof's command writes beside its record."""
    from cable_envs.proof import report

    records = report.parts_of([PROOF / "proof.json.xz"])
    results = report.together(records)
    about = {**records[0], "cases_total": len(next(iter(results.values())))}
    return report.markdown(results, about).encode()


def _recordings_page() -> bytes:
    from cablebench.pages.recordings import render
    from cablebench.pages.recordings_sets import SETS

    return render(RECORDINGS, list(SETS)).encode()


def _reproduction() -> str:
    from cable_envs.reproduction.registry import ITEMS, PAPERS
    from cable_envs.reproduction.yardstick import KINDS, STATUSES

    made = (REPRODUCTION / "results.json").is_file()
    counts = {i["item"]: i["counts"] for i in read_json(REPRODUCTION / "results.json")["items"]} if made else {}
    head = ("item", "what", *((f"{status.sign} {status.name}" for status in STATUSES) if made else ()))
    parts = [
        "# Reproduction",
        "`cablebench reproduce` computes the tables and figures of both papers again and puts each number beside the "
        "printed one. Every row is of one kind, each kind has one tolerance, and five words say what came out. A "
        "number "
        "that differs is a result too: it is called explained where the reason is computed or derived.",
        table(("word", "what it means"), [(f"{status.sign} {status.name}", status.says) for status in STATUSES]),
        table(("kind", "agrees within", "what it compares"), [(k.name, k.agrees, k.says) for k in KINDS]),
    ]
    for key, title in PAPERS.items():
        own = [item for item in ITEMS if item.paper == key]
        lines = [(f"`{i.name}`", i.title, *(str(n) for n in counts.get(i.name, {}).values())) for i in own]
        parts += [f"## {title}", table(head, lines, numbers=range(2, 2 + len(STATUSES)))]
    parts += [link_to("reproduction", "All numbers and figures")] if made else []
    parts.append(
        "Where the papers and their own equations disagree is told on the page of the "
        "[mismatches](mismatches/README.md); the equations are on that of the [physics](physics.md)."
    )
    return page(*parts)


def linked(address: str, text: str) -> str:
    """A hand-written page with the link to the large page that belongs to it, under its heading."""
    links = {
        "proof/proof.md": link_to("proof", "The same with figures: every method, confusion matrix, calibration", up=1),
        "recordings/README.md": link_to("recordings", "The whole page with all figures", up=1),
    }
    if address not in links:
        return text
    return re.sub(r"^(# .+)$", rf"\1\n\n{links[address]}", text, count=1, flags=re.MULTILINE)
