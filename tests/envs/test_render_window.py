"""The window, and what drawing imports: each case in a fresh interpreter, with warnings as errors."""

import os
import subprocess
import sys
import textwrap

import pytest

pytest.importorskip("matplotlib")


def _run(code, **environment):
    """Run ``code`` in a fresh interpreter with warnings as errors."""
    kept = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")}
    script = textwrap.dedent(code)
    return subprocess.run([sys.executable, "-W", "error", "-c", script], env={**kept, **environment},
                          capture_output=True, text=True, timeout=120, check=False)  # fmt: skip


def test_rgb_array_needs_neither_pygame_nor_pyplot_nor_display():
    result = _run("""
        import sys
        sys.modules["pygame"] = None  # import fails
        import cable_envs.render as render
        assert "matplotlib" not in sys.modules
        r = render.Renderer("cable_hole", {}, "t")
        assert r.frame().std() > 0
        assert "matplotlib.pyplot" not in sys.modules
        try:
            h = render.Renderer("cable_hole", {}, "t", mode="human")
            h.show()
        except ImportError as error:
            assert "cable-envs[render]" in str(error)
        else:
            raise SystemExit("no error")
    """)
    assert result.returncode == 0, result.stderr


def test_missing_matplotlib_is_named():
    result = _run("""
        import sys
        sys.modules["matplotlib"] = None
        import cable_envs.render as render
        try:
            render.Renderer("cable_hole", {}, "t")
        except ImportError as error:
            assert "cable-envs[render]" in str(error)
        else:
            raise SystemExit("no error")
    """)
    assert result.returncode == 0, result.stderr


def test_human_window_shows_frames_and_survives_being_closed():
    pytest.importorskip("pygame")
    result = _run("""
        import time
        import numpy as np
        from cable_envs.render import Renderer
        r = Renderer("pulley_circuit", {}, "t", "rad", "human", fps=20)
        start = time.monotonic()
        for k in range(40):
            r.push({"drive_angle": 0.01 * k}, 0.01 * k, 0.0, 0.0)
            r.show()
        assert time.monotonic() - start > 0.25, "faster than the 0.39 s of simulated time allow"
        import pygame
        surface = pygame.display.get_surface()
        assert surface.get_size() == (960, 640)
        r.push({}, 0.45, 0.0, 0.0)
        r.show()
        shown = pygame.surfarray.array3d(surface).swapaxes(0, 1)
        assert np.array_equal(shown, r.frame())
        pygame.event.post(pygame.event.Event(pygame.QUIT))
        r.push({}, 0.46, 0.0, 0.0)
        r.show()
        assert pygame.display.get_surface() is None
        r.push({}, 0.6, 0.0, 0.0)
        r.show()
        assert pygame.display.get_surface() is None, "the window came back"
        r.close()
        r.close()
    """, SDL_VIDEODRIVER="dummy")  # fmt: skip
    assert result.returncode == 0, result.stderr
