"""What the tests of commands share."""

import pytest

from cablebench.cli import main


@pytest.fixture
def cli(capsys):
    """Run a command: (exit code, standard output, standard error)."""

    def run(*arguments):
        with pytest.raises(SystemExit) as end:
            main([str(a) for a in arguments])
        out = capsys.readouterr()
        return end.value.code or 0, out.out, out.err

    return run
