"""A command of ours run within the tests."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from lookonce.cli.app import app
from lookonce.errors import LookonceError

__all__ = ["Command"]


class Command:
    """``lookonce`` with the words that all calls begin with, on a screen of so many columns."""

    def __init__(self, *words: str, columns: int = 80) -> None:
        self._words, self._columns = words, columns

    def run(self, *arguments: object) -> Result:
        runner = CliRunner(env={"COLUMNS": str(self._columns)})
        return runner.invoke(app, [*self._words, *map(str, arguments)])

    def done(self, *arguments: object) -> Result:
        """A run that succeeds."""
        result = self.run(*arguments)
        assert result.exit_code == 0, (result.stderr, result.exception)
        return result

    def refusal(self, *arguments: object) -> str:
        """The one line that a wrong input gets."""
        error = self.run(*arguments).exception
        assert isinstance(error, LookonceError), error
        assert str(error).isprintable()
        return str(error)
