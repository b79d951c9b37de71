"""What headers say: quantities, sides and units in English, German and common abbreviations."""

import math
import re
from collections.abc import Iterable
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit as a mapping file writes it, the factor to it, and its SI unit; "" where it is none of a channel's."""

    name: str
    scale: float
    si: str


_INCH, _POUND, _KILOPOND = 0.0254, 4.4482216152605, 9.80665
COUNTS = "counts"
"""SI unit, so to speak, of what only counts: its scale is not known."""

_UNITS: dict[str, Unit] = {}
for _unit, _names in {
    Unit("s", 1.0, "s"): "s sec secs second seconds sek sekunden",
    Unit("ms", 1.0, "s"): "ms msec millis",
    Unit("us", 1.0, "s"): "us usec µs μs micros",
    Unit("us", 1e-3, "s"): "ns nsec",
    Unit("min", 1.0, "s"): "min",
    Unit("m", 1.0, "m"): "m meter metre",
    Unit("mm", 1.0, "m"): "mm",
    Unit("cm", 1.0, "m"): "cm",
    Unit("um", 1.0, "m"): "um µm μm micron",
    Unit("m", _INCH, "m"): "in inch inches zoll",
    Unit("rad", 1.0, "rad"): "rad radian radians",
    Unit("rad", 1e-3, "rad"): "mrad",
    Unit("deg", 1.0, "rad"): "deg degree degrees grad ° °deg",
    Unit("rad", 2.0 * math.pi, "rad"): "rev revs turn turns umdr umdrehungen u",
    Unit("m/s", 1.0, "m/s"): "m/s mps",
    Unit("mm/s", 1.0, "m/s"): "mm/s mmps",
    Unit("m/s", 0.01, "m/s"): "cm/s",
    Unit("m/s", _INCH, "m/s"): "in/s ips",
    Unit("rad/s", 1.0, "rad/s"): "rad/s radps 1/s",
    Unit("deg/s", 1.0, "rad/s"): "deg/s °/s grad/s dps",
    Unit("rpm", 1.0, "rad/s"): "rpm u/min 1/min umdr/min min^-1 min-1 r/min",
    Unit("N", 1.0, "N"): "n newton newtons",
    Unit("kN", 1.0, "N"): "kn",
    Unit("mN", 1.0, "N"): "mn",
    Unit("N", 0.01, "N"): "cn",
    Unit("N", 10.0, "N"): "dan",
    Unit("N", _POUND, "N"): "lb lbf lbs pounds",
    Unit("N", _KILOPOND, "N"): "kp kgf kg",
    Unit("N m", 1.0, "N m"): "nm n*m n·m newtonmeter",
    Unit("N mm", 1.0, "N m"): "nmm n*mm n·mm",
    Unit("mN m", 1.0, "N m"): "mnm mn*m mn·m",
    Unit("N m", 0.01, "N m"): "ncm n*cm n·cm",
    Unit("N m", _POUND * _INCH, "N m"): "lbin lb-in lbf-in in-lb lbf*in",
    Unit("A", 1.0, "A"): "a amp amps ampere",
    Unit("mA", 1.0, "A"): "ma",
    Unit("V", 1.0, "V"): "v volt volts",
    Unit("V", 1e-3, "V"): "mv",
    Unit("K", 1.0, "K"): "°c degc celsius k kelvin c",
    Unit("Pa", 1.0, "Pa"): "pa bar mbar mpa kpa psi",
    Unit("1", 1.0, "1"): "% 1 -",
    Unit("", 1.0, COUNTS): "counts count cts ink inc inkr inkremente ticks tick lsb digits digit qc",
}.items():
    _UNITS.update(dict.fromkeys(_names.split(), _unit))


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_KINDS = {
    "time": "t sec secs time zeit timestamp zeitstempel tstamp seconds sekunden clock uhr uhrzeit elapsed",
    "m": "x y z s pos position depth tiefe weg hub displacement disp travel stroke verschiebung laenge length "
         "extension auszug location lage",
    "rad": "q phi theta alpha beta angle winkel drehwinkel ang rotation rot gelenkwinkel joint",
    "m/s": "v vel velocity speed geschw geschwindigkeit",
    "rad/s": "omega w drehzahl qd qdot rpm winkelgeschwindigkeit",
    "N": "f force kraft zugkraft tension seilkraft zug loadcell fz fx fy kraftsensor dms pull",
    "N m": "m torque moment drehmoment tau trq mom md effort",
    "A": "i current strom cur iq amps",
    "V": "u voltage spannung volt volts",
    "K": "temp temperature temperatur tmot",
    "count": "n nr no index idx sample samples counter zaehler lfd row seq id frame",
}  # fmt: skip
KIND = {word: kind for kind, words in _KINDS.items() for word in words.split()}
"""Word of a name -> the SI unit of what it means, "time" or "count"."""
COMMAND = _set("cmd command soll sollwert sp setpoint target des desired demand vorgabe ziel stell")
REFERENCE = _set("ref reference fuehrung fuehrungsgroesse referenz")
DRIVE = _set("motor mot drive antrieb actuator aktor input proximal prox winch winde master capstan back m1 an")
OUTPUT = _set("load last output out abtrieb distal dist tip jaw greifer gripper gelenk front slave spitze tool ab "
              "contact kontakt interaction extern external")  # fmt: skip
TURNED = {"m": "rad", "m/s": "rad/s", "N": "N m"}
"""SI unit along a line -> that of a rotation."""
SPECIAL = {
    "top": _set("top oben t upper"), "bottom": _set("bottom unten b lower"),
    "wrap": _set("wrap umschlingung umschlingungswinkel"),
    "band": _set("band"), "reading": _set("reading tacho"),
    "motor": _set("motor mot"),
}  # fmt: skip
"""Part of a channel's name -> words of which a header must have one to be it."""
OF_SYSTEM = {
    "tendon_sheath": "bowden sheath huelle mantel catheter katheter sheathed bowdenzug continuum "
    "kontinuum tip spitze spitzenwinkel",
    "cable_hole": "cable seil tendon sehne rope winch winde hoist hub kabel wrap umschlingung",
    "pulley_circuit": "pulley rolle jaw greifer gripper idler wrist",
    "linear_drive": "axis achse slide schlitten carriage belt riemen stage tisch gantry portal screw spindel spindle "
    "probe sonde needle nadel insertion coil spule",
    "rotary_joint": "joint joints gelenk arm servo pendulum pendel hinge revolute pivot elbow ellbogen knee knie hip "
    "huefte ankle",
}
"""System -> words that speak for it."""
TURNS = _set(OF_SYSTEM["rotary_joint"])
"""Words of a name whose positions, speeds and efforts are of a rotation where no unit is given."""
_BARE = ("N", "V", "A", "s", "m")
"""Units that are words of quantities as well: as the last word of a name they are units, so written."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]*)\s*[\])}>]")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


def unit_of(text: str) -> Unit | None:
    """The unit that a text is; None for none. M and m differ where that tells meganewtons from metres no more.

    Examples
    --------
    >>> unit_of("Grad"), unit_of("N.mm").name, unit_of("Motor")
    (Unit(name='deg', scale=1.0, si='rad'), 'N mm', None)
    """
    plain = text.strip().strip("[](){}<>").strip()
    if plain.lower() in ("nm",) and plain not in ("Nm", "NM", "nm"):
        return None
    key = plain.lower().replace(" ", "").replace(".", "").replace("⋅", "·").replace("^-1", "^-1")
    return _UNITS.get(key)


def speaks_for(words: Iterable[str]) -> frozenset[str]:
    """Systems for which words speak: "seilkraft" speaks as "seil" does, and "armature" not as "arm".

    Examples
    --------
    >>> sorted(speaks_for(["seilkraft", "mm"])), sorted(speaks_for(["armature"]))
    (['cable_hole'], [])
    """
    said = set(words)
    return frozenset(
        system for system, own in OF_SYSTEM.items()
        if any(word in said or (len(word) > 3 and any(one.startswith(word) for one in said)) for word in own.split())
    )  # fmt: skip


def words_of(name: str) -> list[str]:
    """Words of a header, in small letters, without umlauts; the unit in brackets is none of them.

    Examples
    --------
    >>> words_of("Seilkraft_Antrieb [N]"), words_of("motorPos"), words_of("data.load.F1")
    (['seilkraft', 'antrieb'], ['motor', 'pos'], ['data', 'load', 'f', '1'])
    """
    bare = _CAMEL.sub(" ", _BRACKETS.sub(" ", name))
    return re.findall(r"[a-z]+|\d+", bare.lower().translate(_UMLAUTS))


def unit_in(name: str) -> Unit | None:
    """The unit that a header has in brackets, behind "in" or a slash, or as its last word.

    Examples
    --------
    >>> unit_in("Weg in mm").name, unit_in("force (kN)").name, unit_in("speed_deg_s").name, unit_in("q")
    ('mm', 'kN', 'deg/s', None)
    """
    for text in _BRACKETS.findall(name):
        if (found := unit_of(text)) is not None:
            return found
    behind = re.search(r"\s(?:in|/)\s+(\S+)$", name) or re.search(r"\w\s*/\s*([A-Za-z°µ]+)$", name)
    if behind and (found := unit_of(behind.group(1))) is not None:
        return found
    rate = re.search(r"[_\s.](deg|rad|mm|cm|m)[_\s.]?(?:_s|ps)$", name.strip())
    if rate:
        return unit_of(f"{rate.group(1)}/s")
    last = re.search(r"[_\s.]([A-Za-z°µ]+(?:/[a-z]+)?)$", name.strip())
    if last and (last.group(1) in _BARE or last.group(1).lower() not in KIND):
        return unit_of(last.group(1))
    return None


def kinds_of(words: list[str]) -> list[str]:
    """Kinds that the words of a name mean, the longest word first: "seilkraft" says more than "s"."""
    found = []
    for word in sorted(words, key=len, reverse=True):
        kind = KIND.get(word) or next((k for w, k in KIND.items() if len(w) > 3 and w in word), None)
        if kind and kind not in found and (len(word) > 1 or len(words) <= 3):
            found.append(kind)
    if TURNS & set(words):
        found = list(dict.fromkeys(TURNED.get(kind, kind) for kind in found))
    return found
