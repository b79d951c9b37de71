"""Files that a stranger may hand in: damaged, endless, much larger than they look, leading elsewhere, or with code."""

import gzip
import io
import json
import os
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

MARK = "executed"
"""A file that appears in the working folder where code of a hostile file was run."""
TOUCH = f"open({MARK!r}, 'w').close()"
T = np.arange(0.0, 6.0, 0.01)
GOOD = np.column_stack([T, np.sin(2 * T), 0.1 * np.cos(T), np.sin(2 * T - 0.1), 0.1 * np.sin(T)])
HEADER = "t,a,b,c,d"
CHANNELS = {
    "time": {"column": "t", "unit": "s"},
    "drive_angle": {"column": "a", "unit": "rad", "noise_std": 1e-3},
    "drive_torque": {"column": "b", "unit": "N m", "noise_std": 1e-3},
    "output_angle": {"column": "c", "unit": "rad", "noise_std": 1e-3},
    "output_torque": {"column": "d", "unit": "N m", "noise_std": 1e-3},
}


class Bomb:
    """Unpickled, it leaves the mark."""

    def __reduce__(self):
        return exec, (TOUCH,)


@dataclass(frozen=True)
class Hostile:
    """One file: how it is made in a folder, the command that reads it, and whether it may be read after all."""

    name: str
    make: Callable[[Path], None]
    words: tuple[str, ...]
    safe: bool = False


def csv_text(rows=GOOD, header=HEADER, delimiter=","):
    """A table as text."""
    return header + "\n" + "".join(delimiter.join(f"{v:.9g}" for v in row) + "\n" for row in rows)


def recording(folder: Path, table: str | bytes | None = None, data="run.csv", **changes) -> None:
    """A recording in ``rec``, with its table and with keys changed."""
    (folder / "rec").mkdir(exist_ok=True)
    content = {
        "schema": "cable-recording/1", "system": "pulley_circuit", "rig": "zou-table2",
        "records": [{"data": data, "use": "fit"}], "channels": CHANNELS, **changes,
    }  # fmt: skip
    (folder / "rec" / "recording.yaml").write_text(yaml.safe_dump(content))
    if table is not None:
        (folder / "rec" / "run.csv").write_bytes(table.encode() if isinstance(table, str) else table)


def _table(table, **changes):
    return lambda folder: recording(folder, table, **changes)


def _yaml(text):
    def make(folder: Path) -> None:
        (folder / "rec").mkdir()
        content = text.encode() if isinstance(text, str) else text
        (folder / "rec" / "recording.yaml").write_bytes(content)
        (folder / "rec" / "run.csv").write_text(csv_text())

    return make


def _special(kind):
    """``run.csv`` is something else than a file."""

    def make(folder: Path) -> None:
        recording(folder)
        path = folder / "rec" / "run.csv"
        if kind == "fifo":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        else:
            path.symlink_to(kind)

    return make


def _changed(rows, column, value):
    table = GOOD.copy()
    table[rows, column] = value
    return csv_text(table)


def laughs(depth=12, width=10):
    """Aliases of aliases: a few lines that stand for ``width ** depth`` entries."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * width)}]" for k in range(1, depth)]
    return "\n".join(lines) + f"\nschema: cable-recording/1\nsystem: pulley_circuit\ndescription: *a{depth - 1}\n"


def _with_table(text):
    return "\n".join(["schema: cable-recording/1", "system: pulley_circuit", text, ""])


FIRST = ("inspect", "rec")
SEEN = ("diagnose", "rec", "--effects", "backlash", "--out", "out")
TABLES = {
    "empty": b"", "only a header": HEADER + "\n", "one row": csv_text(GOOD[:1]), "ten samples": csv_text(GOOD[:10]),
    "all constant": csv_text(np.column_stack([T, np.ones((len(T), 4))])),
    "one column constant": _changed(slice(None), 2, 1.0), "1e300": _changed(5, 1, 1e300),
    "all 1e300": _changed(slice(None), 1, 1e300), "inf": _changed(5, 1, np.inf), "minus inf": _changed(5, 3, -np.inf),
    "a column of NaN": _changed(slice(None), 1, np.nan), "NaN in time": _changed(7, 0, np.nan),
    "time backwards": csv_text(GOOD[::-1]), "time stands": _changed(slice(None), 0, 1.0),
    "time 1e300": _changed(-1, 0, 1e300), "tiny time": csv_text(GOOD * [1e-300, 1, 1, 1, 1]),
    "random bytes": np.random.default_rng(0).bytes(100_000), "zero bytes": bytes(1_000_000),
    "NUL in a cell": csv_text().replace("0.01", "0.0\x001", 1), "UTF-16": csv_text().encode("utf-16"),
    "latin-1 header": csv_text(header="t,ä,b,c,d").encode("latin-1"), "a line of 50 MB": b"1," * 25_000_000,
    "quote never closed": csv_text().replace("0.02", '"0.02', 1), "half a last line": csv_text()[:-30],
    "a name twice": csv_text(header="t,a,a,c,d"), "missing column": csv_text(header="t,a,b,c,e"),
    "text in a cell": csv_text().replace("0.03", "=cmd|' /C calc'!A0", 1),
    "long digits": csv_text().replace("0.04", "9" * 5000, 1), "hex": csv_text().replace("0.05", "0x10", 1),
    "ragged": csv_text().replace("\n0.06,", "\n0.06,1,", 1),
    "decimal commas": csv_text(delimiter=";").replace(".", ","),
    "a zip": b"PK\x03\x04" + bytes(1000), "gzip": gzip.compress(csv_text().encode()),
    "header of 100000 columns": ",".join(map(str, range(100_000))) + "\n1\n",
    "a pickle": pickle.dumps(Bomb()),
}  # fmt: skip
READABLE = {
    "semicolons": csv_text(delimiter=";", header=HEADER.replace(",", ";")), "BOM": "\ufeff" + csv_text(),
    "CRLF": csv_text().replace("\n", "\r\n"), "no last newline": csv_text()[:-1],
}  # fmt: skip
YAMLS = {
    "billion laughs": laughs(), "alias of itself": "schema: cable-recording/1\nx: &a [*a]\n",
    "deep nesting": "schema: " + "[" * 100_000,
    "python object": _with_table(f"rig: !!python/object/apply:exec [{TOUCH!r}]"),
    "python name": _with_table("rig: !!python/name:os.system"),
    "python new": _with_table("x: !!python/object/new:os.system [ls]"),
    "bad date": "schema: 2001-99-99\n", "not UTF-8": b"schema: \xff\xfe\n", "zero byte": "schema: a\0b\n",
    "a list": "- 1\n- 2\n", "empty": "", "binary": np.random.default_rng(1).bytes(5000),
    "number keys": "1: 2\nschema: cable-recording/1\n", "tabs": "schema:\tx\n\t- y\n",
    "list as key": "? [a, b]\n: c\n", "huge integer": "schema: cable-recording/1\nsystem: " + "9" * 5000 + "\n",
    "two documents": "a: 1\n---\nb: 2\n", "sexagesimal bomb": "schema: " + ":".join(["59"] * 20_000) + "\n",
}  # fmt: skip
CHANGES = {
    "records is text": {"records": "run.csv"}, "records holds null": {"records": [None]},
    "channels is a list": {"channels": [1]}, "a channel is text": {"channels": {**CHANNELS, "time": "t"}},
    "scale NaN": {"channels": {**CHANNELS, "time": {"column": "t", "unit": "s", "scale": float("nan")}}},
    "scale 1e308": {"channels": {**CHANNELS, "drive_angle": {"column": "a", "unit": "deg", "scale": 1e308}}},
    "noise 0": {"channels": {**CHANNELS, "drive_angle": {"column": "a", "unit": "rad", "noise_std": 0}}},
    "unit of objects": {"channels": {**CHANNELS, "time": {"column": "t", "unit": {"a": 1}}}},
    "column is a mapping": {"channels": {**CHANNELS, "time": {"column": {"a": 1}, "unit": "s"}}},
    "rig is a pipe": {"rig": "/dev/stdin"}, "rig is endless": {"rig": "/dev/zero"}, "rig is a list": {"rig": [1, 2]},
    "rig elsewhere": {"rig": "../../../../etc/passwd"}, "rig with zero byte": {"rig": "a\0.yaml"},
    "system is a list": {"system": ["pulley_circuit"]},
    "known 1e400": {"known": {"drive_radius": {"value": float("inf")}}},
    "nominal without value": {"nominal": {"drive_radius": {"std": 1}}}, "source is text": {"source": "x"},
    "offsets 1e300": {"records": [{"data": "run.csv", "offsets": {"drive_angle": 1e300}}]},
    "conditions of objects": {"records": [{"data": "run.csv", "conditions": {"load": {"value": [1]}}}]},
    "quality without end": {"records": [{"data": "run.csv", "quality": [{"kind": "stuck", "from_s": float("nan")}]}]},
}  # fmt: skip
PLACES = {
    "parents": "../../../../../../etc/passwd", "absolute": "/etc/passwd", "absolute csv": "/tmp/x.csv",
    "zero byte": "run\0.csv",
    "long name": "x" * 5000 + ".csv", "no name": "", "a folder": ".", "number": 5, "list": ["run.csv"],
    "device": "/dev/zero",
}  # fmt: skip


def all_of_them() -> list[Hostile]:
    """Every hostile file."""
    found = [Hostile(f"table: {n}", _table(t), FIRST) for n, t in TABLES.items()]
    found += [Hostile(f"table: {n}", _table(t), FIRST, safe=True) for n, t in READABLE.items()]
    found += [Hostile(f"diagnosed: {n}", _table(TABLES[n]), SEEN) for n in (
        "ten samples", "all constant", "1e300", "all 1e300", "a column of NaN", "tiny time", "time 1e300")]  # fmt: skip
    found += [Hostile(f"yaml: {n}", _yaml(t), FIRST) for n, t in YAMLS.items()]
    found += [Hostile(f"keys: {n}", _table(csv_text(), **c), FIRST) for n, c in CHANGES.items()]
    found += [Hostile(f"data: {n}", _table(csv_text(), data=p), FIRST) for n, p in PLACES.items()]
    links = {"fifo": "fifo", "folder": "folder", "link to a device": "/dev/zero", "link to random": "/dev/urandom",
             "link outside": "/etc/passwd", "link to itself": "run.csv", "dead link": "nowhere.csv"}  # fmt: skip
    found += [Hostile(f"file: {n}", _special(k), FIRST) for n, k in links.items()]
    found += [Hostile(f"policy yaml: {n}", _policy(YAMLS[n]), ("run", "CableHole-Position-Sine", "--policy", "p.yaml"))
              for n in ("billion laughs", "alias of itself", "deep nesting", "python object", "not UTF-8", "a list",
                        "binary",                        "empty", "bad date", "number keys", "tabs")]  # fmt: skip
    found += [Hostile(f"evaluated yaml: {n}", _policy(YAMLS[n]),
                      ("evaluate", "--protocol", "demo", "--policy", "p.yaml"))
              for n in ("deep nesting", "python object", "not UTF-8", "binary")]  # fmt: skip
    return found + formats()


def _policy(text):
    def make(folder: Path) -> None:
        (folder / "p.yaml").write_bytes(text.encode() if isinstance(text, str) else text)

    return make


def _logs(name, write, columns=None):
    """A file in ``logs`` with a mapping beside it."""

    def make(folder: Path) -> None:
        (folder / "logs").mkdir()
        write(folder / "logs" / name)
        columns_of = columns or {"time": {"column": "t", "unit": "s"}, "position": {"column": "x", "unit": "m"},
                                 "force": {"column": "f", "unit": "N"}}  # fmt: skip
        content = {"schema": "cable-mapping/1", "system": "linear_drive", "channels": columns_of}
        (folder / "map.yaml").write_text(yaml.safe_dump(content))

    return make


def _import(form):
    return ("import", form, "logs", "--mapping", "map.yaml", "--out", "out")


def _bytes(content):
    return lambda path: path.write_bytes(content)


TOPICS = {"time": {"field": "stamp", "unit": "s"}, "position": {"topic": "/a", "field": "x", "unit": "m"},
          "force": {"topic": "/a", "field": "f", "unit": "N"}}  # fmt: skip


def formats() -> list[Hostile]:
    """Files of loggers and of MATLAB."""
    noise, found = np.random.default_rng(2).bytes(20_000), []
    for form, name, columns in (
        ("mat", "a.mat", None),
        ("mdf", "a.mf4", None),
        ("mcap", "a.mcap", TOPICS),
        ("rosbag", "a.bag", TOPICS),
        ("table", "a.csv", None),
        ("table", "a.parquet", None),
    ):
        heads = {"mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM", "mdf": b"MDF     4.10    ",
                 "mcap": b"\x89MCAP0\r\n",
                 "rosbag": b"#ROSBAG V2.0\n", "table": b"PAR1" if name.endswith("parquet") else b"t,x,f\n"}  # fmt: skip
        for kind, content in (
            ("empty", b""),
            ("noise", noise),
            ("head and noise", heads[form] + noise),
            ("head alone", heads[form]),
            ("zeros", bytes(50_000)),
            ("a pickle", pickle.dumps(Bomb())),
        ):
            found.append(
                Hostile(f"{form} {Path(name).suffix}: {kind}", _logs(name, _bytes(content), columns), _import(form))
            )
        found.append(Hostile(f"{form} {Path(name).suffix}: fifo", _logs(name, os.mkfifo, columns), _import(form)))
        found.append(
            Hostile(
                f"{form} {Path(name).suffix}: device",
                _logs(name, lambda p: p.symlink_to("/dev/zero"), columns),
                _import(form),
            )
        )
    found.append(Hostile("mat: object array", _logs("a.mat", _objects), _import("mat")))
    found.append(Hostile("mat: bomb", _logs("a.mat", _mat_bomb), _import("mat")))
    found.append(
        Hostile(
            "mat: length of 4 GB",
            _logs(
                "a.mat",
                _bytes(
                    b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 14, 2**32 - 1) + bytes(100)
                ),
            ),
            _import("mat"),
        )
    )
    for name, write in (("external link", _link), ("external bytes", _external), ("rows of nothing", _rows)):
        found.append(Hostile(f"hdf5: {name}", _logs("a.mat", write), _import("mat")))
    found.append(Hostile("rosbag2: metadata with objects", _bag2(YAMLS["python object"]), _import("rosbag")))
    found.append(Hostile("rosbag2: metadata of laughs", _bag2(laughs()), _import("rosbag")))
    found.append(
        Hostile("json: band brake, deep", _brake("[" * 200_000), ("import", "band-brake", "logs", "--out", "out"))
    )
    found.append(
        Hostile(
            "json: band brake, no rows",
            _brake(json.dumps({"data": {"a": 1}})),
            ("import", "band-brake", "logs", "--out", "out"),
        )
    )
    found.append(Hostile("npz in place of a table", lambda f: recording(f, _npz()), FIRST))
    return found


def _objects(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"t": np.array([{"a": 1}, "x"], dtype=object), "x": T, "f": T})


def _mat_bomb(path: Path) -> None:
    """5 MB that unpack to 5 GB."""
    packer = zlib.compressobj(9)
    body = b"".join([*(packer.compress(bytes(2**24)) for _ in range(320)), packer.flush()])
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(body)) + body)


def _h5(path: Path, fill: Callable) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("x", "f"):
            file[name] = T
        fill(file)
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _link(path: Path) -> None:
    import h5py

    with h5py.File(path.parent.parent / "elsewhere.h5", "w") as other:
        other["t"] = T
    _h5(path, lambda file: file.__setitem__("t", h5py.ExternalLink("../elsewhere.h5", "t")))


def _external(path: Path) -> None:
    _h5(path, lambda file: file.create_dataset("t", (10,), "f8", external=[("/etc/passwd", 0, 80)]))


def _rows(path: Path) -> None:
    def fill(file):
        for name in ("x", "f"):
            del file[name]
        for name in ("t", "x", "f"):
            file.create_dataset(name, (10**12,), "f8", chunks=(10**6,))

    _h5(path, fill)


def _bag2(text):
    def make(folder: Path) -> None:
        _logs("x.db3", _bytes(b""), TOPICS)(folder)
        (folder / "logs" / "metadata.yaml").write_text(text)

    return make


def _brake(text):
    def make(folder: Path) -> None:
        (folder / "logs").mkdir()
        (folder / "logs" / "dataset2_0.5Hz30lbtension1amplitude.json").write_text(text)

    return make


def _npz() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, t=np.array([Bomb()], dtype=object))
    with zipfile.ZipFile(stream, "a") as archive:
        archive.writestr("../../escaped.npy", b"x")
    return stream.getvalue()
