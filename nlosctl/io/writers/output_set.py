"""Outputs of one run that stand or fall together."""

from __future__ import annotations

from contextlib import ExitStack
from types import TracebackType
from typing import Any, Protocol, TypeVar

from nlosctl.io.writers.atomic_file import writing
from nlosctl.io.writers.byte_output import ByteOutput

__all__ = ["OutputSet"]


class _Output(Protocol):
    @property
    def passes_on(self) -> bool: ...

    def complete(self) -> None: ...

    def __enter__(self) -> Any: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


OutputT = TypeVar("OutputT", bound=_Output)


class OutputSet:
    """A context manager: when its block ends well all outputs are completed before any takes its name.

    So on a full disk none of them is there, instead of some. What goes to standard output or a device is completed
    last, as it can't be taken back.
    """

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._outputs: list[_Output] = []

    def __enter__(self) -> OutputSet:
        return self

    def take(self, output: OutputT) -> OutputT:
        """Open an output, a `TableWriter` or its like, as one of the set."""
        self._stack.enter_context(output)
        self._outputs.append(output)
        return output

    def write_text(self, target: str, text: str) -> None:
        """Write a small text file as one of the set; check the target first with `check_targets`."""
        with writing(target):
            self.take(ByteOutput(target)).sink.write(text.encode("utf-8"))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:  # what goes wrong here leaves no file either
            if kind is not None:
                self._stack.__exit__(kind, error, trace)
                return
            for output in sorted(self._outputs, key=lambda output: output.passes_on):
                output.complete()
