"""Check the type hints by mypy: the list of clean modules only grows, all other errors only become fewer."""

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = "workflow/accelerated_evaluation"
# Modules and packages without an error. A new one is added here as soon as its last error is mended.
CLEAN = (
    f"{LIBRARY}/__init__.py",
    f"{LIBRARY}/__init__.pyi",
    f"{LIBRARY}/answer/ways/answer.py",
    f"{LIBRARY}/answer/candidates/law_study.py",
    f"{LIBRARY}/base",
    f"{LIBRARY}/laws/draws.py",
    f"{LIBRARY}/laws/protocol.py",
    f"{LIBRARY}/methods",
    f"{LIBRARY}/scenarios",
    f"{LIBRARY}/study/door.py",
    "fewruns/src/fewruns",
)
# Guides whose Python code is checked as a caller's, and whether it is one program.
GUIDES = {"docs/interface.md": True, "docs/extensions.md": False, "fewruns/README.md": True}
WRITTEN = ".mypy_cache/guides"  # folder for these programs, which have no error
# A guide knows which parts its answer has, and may use a library that is not installed.
OF_GUIDES = '# mypy: disable-error-code="union-attr,import-not-found"\n'
ELSEWHERE = 248


def errors_of(output: str) -> Counter[str]:
    """Return the number of errors in each file, by what mypy prints."""
    return Counter(re.findall(r"^(\S+?):\d+(?::\d+)?: error:", output, re.MULTILINE))


def judged(errors: Mapping[str, int], clean: tuple[str, ...] = CLEAN, allowed: int = ELSEWHERE) -> str | None:
    """Return what is wrong with the number of errors in each file; None if nothing is."""
    spoilt = [f"{path} ({errors[path]})" for path in sorted(errors) if is_clean(path, clean)]
    if spoilt:
        return f"errors in modules of CLEAN: {', '.join(spoilt)}. Mend the errors above."
    elsewhere = sum(errors.values())
    if elsewhere > allowed:
        limit = f"{elsewhere} errors in the modules that are not in CLEAN, expected: at most {allowed}."
        return f"{limit} Mend the errors above that your change has added."
    if elsewhere < allowed:
        return f"only {elsewhere} errors of {allowed} are left. Set ELSEWHERE to {elsewhere}."
    return None


def is_clean(path: str, clean: tuple[str, ...] = CLEAN) -> bool:
    """Return whether a file is, or lies in, one of the modules and packages of a list."""
    return any(path == each or path.startswith(f"{each}/") for each in clean)


def programs(guide: str, text: str, *, is_one: bool) -> dict[str, str]:
    """Return the Python programs in a guide by a name for each; those with an ellipsis are left out."""
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    whole = [block for block in blocks if "    ...\n" not in block]
    name = re.sub(r"\W", "_", guide.removesuffix(".md"))
    found = ["\n".join(whole)] if is_one else whole
    return {f"{name}_{number}.py": OF_GUIDES + block for number, block in enumerate(found, 1)}


def main() -> int:
    """Run mypy with the settings of pyproject.toml; return 1 unless its errors are as stated here."""
    folder = ROOT / WRITTEN
    folder.mkdir(parents=True, exist_ok=True)
    paths = ["fewruns/src/fewruns", LIBRARY]
    for guide, is_one in GUIDES.items():
        for name, text in programs(guide, (ROOT / guide).read_text("utf-8"), is_one=is_one).items():
            (folder / name).write_text(text, "utf-8")
            paths.append(f"{WRITTEN}/{name}")
    command = [sys.executable, "-m", "mypy", "--no-error-summary", *paths]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    errors = errors_of(run.stdout)
    wrong = judged(errors, (*CLEAN, WRITTEN)) if run.returncode in (0, 1) else run.stdout + run.stderr
    if wrong is None:
        return 0
    print(run.stdout, file=sys.stderr)
    print(f"mypy: {wrong}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
