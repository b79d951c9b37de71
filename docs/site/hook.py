"""What MkDocs calls while it builds the site: the made pages come in, links out of docs/ lead somewhere."""

import posixpath
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from docs.site import api, controllers, effects, environments, plants, reports, suite  # noqa: E402
from docs.site.tables import readable  # noqa: E402

MAKERS = (environments, suite, plants, effects, controllers, reports, api)
BESIDE = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages at the top of the checkout and where the site has them."""
BOARDS = {f"boards/{name}/board.md": f"{reports.FOLDER}/board-{name}/board.html" for name in reports.BOARDS}
ELSEWHERE = {"README.md": "index.md", **BESIDE, **BOARDS}
"""Files of the checkout whose content the site has under another address."""
DRAWING = re.compile(r'<img [^>]*?src="([^"]+\.svg)"(?![^>]* width=)')
PIXELS = 1.47
"""Of a point of a drawing: a letter of 7.5 points has 11 pixels."""
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Put in what the makers make; a file of the same address gives way."""
    made: dict[str, str | bytes] = {}
    for maker in MAKERS:
        made |= maker.pages()
    made |= {address: (ROOT / name).read_text(encoding="utf-8") for name, address in BESIDE.items()}
    for address, content in made.items():
        old = files.get_file_from_path(address)
        if old is not None:
            files.remove(old)
        files.append(File.generated(config, address, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links that leave docs/: to a page of the site where there is one, else to the repository, else plain text."""
    address = page.file.src_uri
    top = {made: name for name, made in BESIDE.items()}
    here = posixpath.join("docs", address) if address not in top else top[address]

    def turned(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        if re.match(r"[a-z]+:", target) or target.startswith("/"):
            return found[0]
        whole = posixpath.normpath(posixpath.join(posixpath.dirname(here), target))
        inside = ELSEWHERE.get(whole) or (whole.removeprefix("docs/") if whole.startswith("docs/") else None)
        if inside is not None and files.get_file_from_path(inside) is not None:
            return f"[{words}]({posixpath.relpath(inside, posixpath.dirname(address) or '.')}{anchor})"
        if config.repo_url:
            return f"[{words}]({config.repo_url.rstrip('/')}/blob/main/{whole}{anchor})"
        return words

    return LINK.sub(turned, reports.linked(address, markdown))


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Drawings say how large they are, so that the page keeps the size of their letters; tables are `readable`."""

    def sized(found: re.Match[str]) -> str:
        address = posixpath.normpath(posixpath.join(posixpath.dirname(page.file.dest_uri), found[1]))
        file = files.get_file_from_path(address)
        box = re.search(r'viewBox="[\d.]+ [\d.]+ ([\d.]+) ([\d.]+)"', file.content_string) if file else None
        if box is None:
            return found[0]
        width, height = (round(float(size) * PIXELS) for size in box.groups())
        return f'{found[0]} width="{width}" height="{height}"'

    return DRAWING.sub(sized, readable(html))
