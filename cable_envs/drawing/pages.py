"""HTML pages of one look: a page's own template extends ``page.html.j2`` of this folder. No network, one file each."""

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

_SHARED = ("page.html.j2", "page.css", "parts.html.j2")


def render(
    package: str,
    template: str,
    content: Mapping[str, Any],
    filters: Mapping[str, Callable[..., Any]] | None = None,
    helpers: Mapping[str, Callable[..., Any]] | None = None,
) -> str:
    """A page as text.

    Parameters
    ----------
    package : str
        Package that holds the template.
    template : str
        Path of the template in the package. It begins with ``{% extends "page.html.j2" %}`` and fills the blocks title,
        header, main, footer and script; figures are shown with the macros of ``parts.html.j2``.
    content : mapping
        What the template shows, by name. Texts are escaped unless they are `markupsafe.Markup`.
    filters : mapping, optional
        Further filters of the template, by name.
    helpers : mapping, optional
        Functions that the template and its macros call, by name.

    Returns
    -------
    str
        The page: it holds its style and its figures, follows the reader's preference for light or dark, and fits the
        width of a phone.

    Raises
    ------
    jinja2.UndefinedError
        Where the template asks for what ``content`` does not have.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    def source(name: str) -> str:
        place = files("cable_envs").joinpath("drawing/templates") if name in _SHARED else files(package)
        return place.joinpath(name).read_text(encoding="utf-8")

    environment = Environment(
        loader=FunctionLoader(source), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(filters or {})
    environment.globals.update(helpers or {})
    return environment.get_template(template).render(**content)
