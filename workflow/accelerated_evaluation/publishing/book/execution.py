"""Run a parameterised notebook with papermill, in this process instead of a kernel."""

import os
import sys
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.interactiveshell import ExecutionResult, InteractiveShell
from IPython.utils.capture import CapturedIO, capture_output
from traitlets.config import Config

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.publishing.book.texts import fill
from accelerated_evaluation.study.jobs import without

with without("rfc3987_syntax"):
    import nbformat
    import papermill
    from nbformat import NotebookNode
    from papermill.engines import Engine, NotebookExecutionManager, papermill_engines
    from papermill.exceptions import PapermillExecutionError

ENGINE = "this process"


class ThisProcess(Engine):
    """Runs the cells in this process, because starting a kernel takes longer than most of the notebooks."""

    @classmethod
    def execute_managed_notebook(
        cls,
        nb_man: NotebookExecutionManager,
        kernel_name: str,
        **_: Any,  # noqa: ANN401
    ) -> None:
        """Run the cells up to the first error, which papermill raises after it has saved the notebook.

        The texts between the cells are filled in when they are reached (`publishing.book.texts`).
        """
        # Figures that are shown without being saved are displayed in the notebook, as a kernel does it.
        os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
        shell = InteractiveShell.instance(config=Config({"HistoryManager": {"enabled": False}}))
        shell.reset()
        ran = 0
        for number, cell in enumerate(nb_man.nb.cells):
            nb_man.cell_start(cell, number)
            if cell.cell_type == "code":
                ran += 1
                cell.execution_count = ran
                with capture_output() as captured:
                    # The last expression of a cell goes to this hook, what `display` shows to `display_pub`.
                    shell.display_trap.hook = CapturingDisplayHook(shell, shell.display_pub.outputs)
                    result = shell.run_cell(cell.source)
                cell.outputs = [*_outputs(captured), *_errors(result)]
                if not result.success:
                    nb_man.cell_exception(cell, number, exception=result.error_in_exec)
                    return
            elif cell.cell_type == "markdown":
                cell.source = _filled(cell.source, shell.user_ns, ran)
            nb_man.cell_complete(cell, number)


papermill_engines.register(ENGINE, ThisProcess)


def run_notebook(notebook: str, parameters: dict[str, str], executed: str) -> None:
    """Execute a notebook, whose code makes figures and tables, and whose texts have placeholders.

    Parameters
    ----------
    notebook
        Path of the notebook.
    parameters
        Values for the names in its cell of parameters.
    executed
        Path for the notebook with all outputs, and with all texts filled in.

    Raises
    ------
    StudyError
        With cell and message, if the code or a text of the notebook fails.
    """
    with atomic_path(executed) as temporary, _main_module_kept():
        try:
            papermill.execute_notebook(notebook, temporary, parameters, engine_name=ENGINE, progress_bar=True)
        except PapermillExecutionError as error:
            raise StudyError(f"{notebook}, cell {error.exec_count}: {error.ename}: {error.evalue}") from error
        except StudyError as error:
            raise StudyError(f"{notebook}, {error}") from error


@contextmanager
def _main_module_kept() -> Iterator[None]:
    """Put the main module of this process back, in whose place the interactive shell puts its own.

    Without it no process could be spawned afterwards: its start reads the specification of the main module.
    """
    main = sys.modules["__main__"]
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _filled(text: str, names: dict[str, Any], ran: int) -> str:
    """Fill in the text that follows so many cells of code."""
    try:
        return fill(text, names)
    except StudyError as error:
        raise StudyError(f"text after cell {ran}: {error}") from error


def _outputs(captured: CapturedIO) -> Iterator[NotebookNode]:
    """Yield what a cell printed and displayed, pictures as text."""
    for name in ("stdout", "stderr"):
        if text := getattr(captured, name):
            yield nbformat.v4.new_output("stream", name=name, text=text)
    for shown in captured.outputs:
        data = {
            kind: b64encode(value).decode() if isinstance(value, bytes) else value
            for kind, value in shown.data.items()
        }
        yield nbformat.v4.new_output("display_data", data=data, metadata=shown.metadata or {})


def _errors(result: ExecutionResult) -> Iterator[NotebookNode]:
    """Yield the error that a cell ended with, if any."""
    error = result.error_before_exec or result.error_in_exec
    if error is not None:
        yield nbformat.v4.new_output("error", ename=type(error).__name__, evalue=str(error), traceback=[])
