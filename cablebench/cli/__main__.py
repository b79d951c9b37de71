"""``python -m cablebench.cli`` is ``cablebench``."""

from cablebench.cli import main

main()
