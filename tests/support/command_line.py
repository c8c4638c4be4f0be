"""Commands of `swarmdata` in the test's own process."""

from typer.testing import CliRunner

from swarmdata.cli.main import app


def run(*words: object, code: int = 0) -> str:
    """What a command prints, whose exit code is as expected."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result.output
