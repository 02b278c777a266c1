"""Run a parameterised notebook with papermill in this process."""

import json
import os
import sys
from base64 import b64encode
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from IPython.core.displayhook import CapturingDisplayHook
from IPython.core.interactiveshell import ExecutionResult, InteractiveShell
from IPython.utils.capture import CapturedIO, capture_output
from traitlets.config import Config

from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.base.files import atomic_path
from accelerated_evaluation.publishing.study import Study
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
        """Run the cells of a notebook in order, up to the first error.

        Papermill calls this method, saves the notebook, and raises the error afterwards. A cell that shows a
        text (`publishing.texts`) is replaced by this text, as a cell of Markdown. The name of the
        kernel is ignored, because none is started.
        """
        # Figures that a cell shows without saving them are embedded in the notebook, as in a kernel.
        os.environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
        import matplotlib as mpl  # reads the environment variable

        mpl.rcdefaults()  # the user's matplotlibrc would give other figures
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
            nb_man.cell_complete(cell, number)
            if is_text(cell):
                (shown,) = cell.outputs
                cell.cell_type, cell.source = "markdown", shown.data["text/markdown"]
                del cell["outputs"], cell["execution_count"]
                cell.metadata.pop("jupyter", None)  # which would hide the text
        if isinstance(study := shell.user_ns.get("study"), Study):
            nb_man.nb.metadata["study"] = _as_declared(nb_man.nb.metadata.get("study", {}), study)


papermill_engines.register(ENGINE, ThisProcess)


def is_text(cell: NotebookNode) -> bool:
    """Return whether a cell shows a text with placeholders."""
    return cell.cell_type == "code" and cell.source.startswith("%%text")


def run_notebook(notebook: str, parameters: dict[str, str], executed: str) -> None:
    """Execute a notebook with given parameters.

    StudyError is raised if a cell fails, which the error names, or if the notebook used something that its
    metadata do not declare.
    """
    with atomic_path(executed) as temporary, _main_module_kept():
        try:
            papermill.execute_notebook(
                notebook,
                temporary,
                parameters,
                engine_name=ENGINE,
                request_save_on_cell_execute=False,  # the whole notebook would be written twice for each cell
                progress_bar=True,
            )
        except PapermillExecutionError as error:
            raise StudyError(f"{notebook}, cell {error.exec_count}: {error.ename}: {error.evalue}") from error
        except StudyError as error:
            raise StudyError(f"{notebook}, {error}") from error


def _as_declared(declared: Mapping[str, Any], study: Study) -> dict[str, list[str]]:
    """Return what a notebook read and published; StudyError if ``declared`` does not list all of it."""
    used = study.used._asdict() | {"reads": sorted(study.used.reads)}
    parts = [declared, *declared.get("optional", [])]
    listed = {key: {name for part in parts for name in part.get(key, [])} for key in used}
    if missing := sorted({name for key in used for name in set(used[key]) - listed[key]}):
        raise StudyError(
            f'key study of the metadata: {", ".join(missing)} not listed; write "study": {json.dumps(used)}'
        )
    return used


@contextmanager
def _main_module_kept() -> Iterator[None]:
    """Restore the module ``__main__`` at the end, which the interactive shell replaces by its own.

    Otherwise no process could be spawned afterwards, because `multiprocessing` reads the attributes of
    ``__main__``.
    """
    main = sys.modules["__main__"]
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _outputs(captured: CapturedIO) -> Iterator[NotebookNode]:
    """Yield the outputs of a cell: printed text, and displayed objects with images in Base64."""
    for name in ("stdout", "stderr"):
        if text := getattr(captured, name):
            yield nbformat.v4.new_output("stream", name=name, text=text)
    for shown in captured.outputs:
        if not shown.data:  # a figure has displayed itself
            continue
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
