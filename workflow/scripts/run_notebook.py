"""Run a parameterised notebook and render it as HTML."""

from accelerated_evaluation.errors import StudyError
from accelerated_evaluation.files import atomic_path, write_text
from accelerated_evaluation.imports import without
from accelerated_evaluation.jobs import job

with without("rfc3987_syntax"):
    import nbformat
    import papermill
    from nbconvert import HTMLExporter
    from papermill.exceptions import PapermillExecutionError


def main(notebook: str, parameters: dict[str, str], executed: str, html: str) -> None:
    """Execute the notebook with papermill in the folder of the project; its code makes figures and tables."""
    with atomic_path(executed) as temporary:
        try:
            papermill.execute_notebook(
                notebook, temporary, parameters, kernel_name="python3", progress_bar=True
            )
        except PapermillExecutionError as error:
            raise StudyError(f"{notebook}, cell {error.exec_count}: {error.ename}: {error.evalue}") from error
        content = nbformat.read(temporary, as_version=4)
        exporter = HTMLExporter(embed_images=True, exclude_input_prompt=True, exclude_output_prompt=True)
        write_text(html, exporter.from_notebook_node(content)[0])


if __name__ == "__main__":
    with job(snakemake.log[0]):
        main(
            snakemake.input.notebook,
            dict(snakemake.params.parameters),
            snakemake.output.executed,
            snakemake.output.html,
        )
