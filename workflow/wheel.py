"""What the wheel contains besides its packages, as the build backend asks for it."""

from pathlib import Path

from pdm.backend.hooks import Context


def pdm_build_update_files(context: Context, files: dict[str, Path]) -> None:
    """Add what the library reads outside its package, see its module base/files.py."""
    if context.target == "wheel":
        patterns = ("config/config.yaml", "workflow/titles.yaml", "workflow/report/*.rst", "data/**/*")
        for path in (path for pattern in patterns for path in context.root.glob(pattern)):
            name = path.relative_to(context.root)
            if path.is_file() and name.parts[1] != "raw":  # the recordings of a user
                files[f"accelerated_evaluation/project/{name}"] = path
