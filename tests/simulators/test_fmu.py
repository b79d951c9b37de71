"""Functional mock-up units: a cart of a few lines of C, built here as FMI 2 and as FMI 3."""

import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.simulators import FmuSimulator
from tests.simulators.rigs import CART, cart

VARIABLES = ("mass", "damping", "force", "slide", "position", "velocity", "position_start", "velocity_start")
SOURCE = r"""
#include <stdlib.h>
#include <stddef.h>
typedef struct { double v[8]; } Cart;
static double faster(Cart *c, double v) { return (c->v[2] + c->v[3] - c->v[1] * v) / c->v[0]; }
static void step(Cart *c, double h) {
    double x = c->v[4], v = c->v[5];
    double a1 = faster(c, v), a2 = faster(c, v + 0.5 * h * a1), a3 = faster(c, v + 0.5 * h * a2);
    double a4 = faster(c, v + h * a3);
    c->v[4] = x + h * v + h * h / 6.0 * (a1 + a2 + a3);
    c->v[5] = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
}
static void reset(Cart *c) { int k; c->v[0] = 2.0; for (k = 1; k < 8; k++) c->v[k] = 0.0; }
static void *made(void) { Cart *c = malloc(sizeof(Cart)); reset(c); return c; }
static int begun(Cart *c) { c->v[4] = c->v[6]; c->v[5] = c->v[7]; return 0; }
static int get(Cart *c, const unsigned *r, size_t n, double *v) {
    for (size_t k = 0; k < n; k++) v[k] = c->v[r[k]];
    return 0;
}
static int set(Cart *c, const unsigned *r, size_t n, const double *v) {
    for (size_t k = 0; k < n; k++) c->v[r[k]] = v[k];
    return 0;
}
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
void *fmi2Instantiate(const char *n, int t, const char *g, const char *l, const void *f, int v, int d) {
    return made();
}
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetupExperiment(void *c, int a, double b, double s, int e, double f) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2ExitInitializationMode(void *c) { return begun(c); }
int fmi2Terminate(void *c) { return 0; }
int fmi2Reset(void *c) { reset(c); return 0; }
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *v) { return get(c, r, n, v); }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v) { return set(c, r, n, v); }
int fmi2DoStep(void *c, double now, double h, int p) { if (((Cart *)c)->v[0] > 19.0) return 3; step(c, h); return 0; }
const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(const char *n, const char *t, const char *r, _Bool v, _Bool l, _Bool e, _Bool y,
    const unsigned *i, size_t k, void *x, void *m, void *u) { return made(); }
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, _Bool a, double b, double s, _Bool e, double f) { return 0; }
int fmi3ExitInitializationMode(void *c) { return begun(c); }
int fmi3Terminate(void *c) { return 0; }
int fmi3Reset(void *c) { reset(c); return 0; }
int fmi3GetFloat64(void *c, const unsigned *r, size_t n, double *v, size_t m) { return get(c, r, n, v); }
int fmi3SetFloat64(void *c, const unsigned *r, size_t n, const double *v, size_t m) { return set(c, r, n, v); }
int fmi3DoStep(void *c, double now, double h, _Bool p, _Bool *e, _Bool *t, _Bool *y, double *l) {
    if (((Cart *)c)->v[0] > 19.0) return 3;
    step(c, h); *e = 0; *t = 0; *y = 0; *l = now + h; return 0;
}
"""


def _described(version):
    """modelDescription.xml."""
    rows = []
    for reference, name in enumerate(VARIABLES):
        kind = "input" if name in ("force", "slide") else "output" if name in ("position", "velocity") else "parameter"
        start = "" if kind == "output" else ' start="0.0"'
        more = 'causality="{}" variability="{}"'.format(kind, "tunable" if kind == "parameter" else "continuous")
        if version == "2.0":
            rows.append(
                f'<ScalarVariable name="{name}" valueReference="{reference}" {more}><Real{start}/></ScalarVariable>'
            )
        else:
            rows.append(f'<Float64 name="{name}" valueReference="{reference}" {more}{start}/>')
    if version == "3.0":
        rows.append('<Float64 name="time" valueReference="100" causality="independent" variability="continuous"/>')
    token = "guid" if version == "2.0" else "instantiationToken"
    outputs = (
        '<Outputs><Unknown index="5"/><Unknown index="6"/></Outputs>' if version == "2.0"
        else '<Output valueReference="4"/><Output valueReference="5"/>'
    )  # fmt: skip
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{version}" modelName="cart" '
        f'{token}="cart"><CoSimulation modelIdentifier="cart" canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{''.join(rows)}</ModelVariables><ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    """Builds a unit of a version."""
    pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'cable-envs[fmi]'")
    compiler = shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("a unit is built with gcc on Linux")
    folder = tmp_path_factory.mktemp("fmu")
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

    wanted = {n for k, p in ((FMU2Slave, "fmi2"), (FMU3Slave, "fmi3")) for n in dir(k) if n.startswith(p)}
    others = [f"int {name}(void) {{ return 3; }}" for name in sorted(wanted) if f"{name}(" not in SOURCE]
    (folder / "cart.c").write_text(SOURCE + "\n".join(others))
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", folder / "cart.so", folder / "cart.c"], check=True)
    from fmpy import platform, platform_tuple

    def built(version):
        path = folder / f"cart{version[0]}.fmu"
        place = platform if version == "2.0" else platform_tuple
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", _described(version))
            archive.write(folder / "cart.so", f"binaries/{place}/cart.so")
        return path

    return built


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_unit_moves_as_the_same_cart_in_python(unit, version):
    made = FmuSimulator(CART, unit(version))
    force = 5.0 * np.sin(0.1 * np.arange(120))
    given = ({"force": force}, {"mass": 1.5, "damping": 0.7}, {"position": 0.1, "velocity": -0.2})
    for added in ({}, {"slide": np.cos(0.05 * np.arange(120))}):
        mine, other = made.simulate(*given, added), cart().simulate(*given, added)
        for name in other:
            assert np.allclose(mine[name], other[name], rtol=0.0, atol=1e-12), name  # the same steps, another order
    assert np.array_equal(made.simulate(*given)["position"], made.simulate(*given)["position"])  # a reset forgets


def test_physics_is_added_at_the_ports_of_a_unit(unit):
    rig = {"schema": "cable-simulator/1", "simulator": "cart", "parameters": {}, "effects": {
        "coulomb_friction": {"slide.level": 1.5}, "actuator_lag": {"force.time": 0.02}}}  # fmt: skip
    force = 5.0 * np.sin(0.1 * np.arange(200))
    seen = [s.corrected(rig).simulate({"force": force}) for s in (FmuSimulator(CART, unit("3.0")), cart())]
    assert np.allclose(seen[0]["position"], seen[1]["position"], rtol=0.0, atol=1e-9)
    assert np.max(np.abs(seen[0]["position"] - cart().simulate({"force": force})["position"])) > 0.05


def test_bad_units_are_refused_by_name(unit, tmp_path):
    with pytest.raises(ConfigurationError, match=r"no such FMU"):
        FmuSimulator(CART, tmp_path / "none.fmu")
    (tmp_path / "text.fmu").write_text("text")
    with pytest.raises(ConfigurationError, match="cannot be read as an FMU"):
        FmuSimulator(CART, tmp_path / "text.fmu")
    with pytest.raises(ConfigurationError, match=r"unknown variable of cart2.fmu 'F'"):
        FmuSimulator(CART, unit("2.0"), variables={"force": "F"})


def test_without_fmpy_the_error_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    (tmp_path / "cart.fmu").write_bytes(b"")
    with pytest.raises(ConfigurationError, match=r"cable-envs\[fmi\]"):
        FmuSimulator(CART, tmp_path / "cart.fmu")
