"""A study as an RO-Crate: all of its inputs, code and results in one file.

The crate conforms to the profile Provenance Run Crate 0.5, which extends Workflow Run Crate. The workflow has
a step for each rule. The tool of a step is the code of the rule, with a digest. An action for each job
records the inputs and outputs of the tool, and the times.
"""

import hashlib
import mimetypes
import platform
from collections.abc import Iterator, Sequence
from importlib.metadata import distributions, version
from io import StringIO
from pathlib import Path

from rocrate.model.contextentity import ContextEntity
from rocrate.model.entity import Entity
from rocrate.rocrate import ROCrate
from tqdm import tqdm

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.extensions import known
from accelerated_evaluation.base.files import PROJECT, atomic_path, file_digest
from accelerated_evaluation.publishing.provenance import commit_of
from accelerated_evaluation.publishing.run_records import Job, jobs_of, require_unchanged
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.study.dependencies import files_of

PERMALINK = "https://w3id.org/ro/wfrun/{}/0.5"
PROFILES = {name: PERMALINK.format(name) for name in ("process", "workflow", "provenance")}
WORKFLOW_CRATE = "https://w3id.org/workflowhub/workflow-ro-crate/1.0"
TERMS = "https://w3id.org/ro/terms/workflow-run/context"
PARTS: tuple[str, ...] = (
    "workflow",
    "notebooks",
    "config",
    "docs",
    "fewruns",
    "profiles",
    "Snakefile",
    "Makefile",
    "pyproject.toml",
)
PARTS += ("environment.txt", "README.md", "LICENSE", "CITATION.cff", "article")
BENCHMARKS: tuple[str, ...] = (
    "worlds",
    "motorway",
    "motorway_chain",
    "samplers",
    "successors",
)
BENCHMARKS += ("answers", "chance", "hidden", "vehicles")
PARTS += tuple(f"benchmarks/results/{name}.csv" for name in BENCHMARKS)
INSTALLED = "environment_installed.txt"
SNAKEMAKE = "https://snakemake.github.io"
TYPES = {".parquet": "application/vnd.apache.parquet", ".smk": "text/x-python", ".npz": "application/zip"}
TYPES |= {".ipynb": "application/x-ipynb+json", ".yaml": "application/yaml", ".md": "text/markdown"}


def write_crate(study: Study, target: Path, licence: str) -> int:
    """Write the crate of a finished study, which was run in this folder, as a ZIP file.

    The result is the number of files in it, and the licence is a name or the address of a text. InputError is
    raised if the study was not run here, is not finished, or was made by other code than the present one.
    """
    study.path("config.json")
    jobs = jobs_of([study.results, study.figures])
    require_unchanged(jobs)
    crate = ROCrate(version="1.1")
    crate.metadata.extra_contexts.append(TERMS)
    files = _add_files(crate, jobs)
    _describe(crate, study, jobs, licence)
    workflow = _add_workflow(crate, files, jobs)
    _add_run(crate, workflow, files, jobs, study)
    with atomic_path(target) as temporary:
        crate.write_zip(temporary)
    return len(list(crate.get_by_type("File")))


def _add_files(crate: ROCrate, jobs: Sequence[Job]) -> dict[str, Entity]:
    """Add the files of the project and of the study to the crate, each with its SHA-256.

    The entities are found by the path in the crate and by that in the records of the jobs. InputError is
    raised if a job read or wrote a file that no longer exists.
    """
    project = [path for part in PARTS for path in _files(PROJECT / part)]
    extensions = [path for each in known().values() for path in each.files]  # code of a user's own
    paths = {_name(path): path for path in (*project, *extensions)}
    places = {str(path): name for name, path in paths.items()}
    for path in sorted({path for job in jobs for path in (*job.inputs, *job.outputs)}):
        places[path] = _name(Path(path))
        paths[places[path]] = Path(path)
    files = {}
    for name, path in tqdm(sorted(paths.items()), desc="Adding files", unit=" files"):
        kind = TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "text/plain"
        facts = {"sha256": file_digest(path), "encodingFormat": kind, "contentSize": str(path.stat().st_size)}
        files[name] = crate.add_file(path, name, properties={"name": path.name, **facts})
    return files | {path: files[name] for path, name in places.items()}


def _describe(crate: ROCrate, study: Study, jobs: Sequence[Job], licence: str) -> None:
    """Add title, licence and profiles to the crate, and a file that lists the installed packages."""
    last = max(job.ended for job in jobs)
    crate.name = f"Crash probability of cut-ins, study {study.name}"
    crate.description = f"The study {study.name}, with all that it was made from. Data: {study.source}."
    crate.license = licence
    crate.datePublished = last.isoformat(timespec="seconds")
    crate.root_dataset["version"] = commit_of(PROJECT)
    for address in (*PROFILES.values(), WORKFLOW_CRATE):
        version = address.rsplit("/", 1)[1]
        profile = {"@type": "CreativeWork", "name": address.split("/")[-2], "version": version}
        entity = crate.add(ContextEntity(crate, address, properties=profile))
        crate.root_dataset.append_to("conformsTo", entity)
    crate.add_file(
        StringIO(_installed()),
        INSTALLED,
        properties={
            "name": INSTALLED,
            "description": "Python and its packages where the crate was made",
            "encodingFormat": "text/plain",
        },
    )


def _add_workflow(crate: ROCrate, files: dict[str, Entity], jobs: Sequence[Job]) -> Entity:
    """Add the workflow, with a step and a tool for each rule that ran, and the two parameters of a study."""
    snakefile = "workflow/Snakefile"
    crate.delete(files[snakefile])
    facts = {key: files[snakefile][key] for key in ("name", "sha256", "encodingFormat", "contentSize")}
    facts |= {"@type": ["File", "SoftwareSourceCode", "ComputationalWorkflow", "HowTo"]}
    facts |= {"version": commit_of(PROJECT), "description": "The workflow; its rules are in workflow/rules."}
    workflow = crate.add_workflow(
        PROJECT / snakefile, snakefile, properties=facts, main=True, lang="snakemake"
    )
    files[snakefile] = workflow
    workflow["softwareRequirements"] = [files["environment.txt"], crate.get(INSTALLED)]
    for position, rule in enumerate(dict.fromkeys(job.rule for job in jobs), start=1):
        ran = next(job for job in jobs if job.rule == rule)
        tool = _tool(crate, rule, files, _code(ran, files))
        step = {"@type": "HowToStep", "name": rule, "position": str(position)}
        workflow.append_to("hasPart", tool)
        entity = crate.add(ContextEntity(crate, f"#step/{rule}", properties=step))
        entity["workExample"] = tool
        workflow.append_to("step", entity)
    return workflow


def _tool(crate: ROCrate, rule: str, files: dict[str, Entity], code: Sequence[str]) -> Entity:
    """Add the code of a rule: its script or notebook, and the packages of the library that it may use."""
    lines = "".join(f"{files[path].id} {files[path]['sha256']}\n" for path in code)
    facts = {
        "@type": "SoftwareApplication",
        "name": rule,
        "description": f"Code of the rule {rule}; its version is the SHA-256 of its parts' checksums.",
        "softwareVersion": hashlib.sha256(lines.encode()).hexdigest(),
    }
    tool = crate.add(ContextEntity(crate, f"#rule/{rule}", properties=facts))
    tool["hasPart"] = [files[path] for path in code]
    return tool


def _add_run(
    crate: ROCrate, workflow: Entity, files: dict[str, Entity], jobs: Sequence[Job], study: Study
) -> None:
    """Add an action for each job and one for the whole run, and link each to its inputs and outputs."""
    made = {path for job in jobs for path in job.outputs}
    given = sorted({path for job in jobs for path in _data(job) if path not in made})
    settings = str(study.results / "config.json")
    engine = {"@type": "SoftwareApplication", "name": "Snakemake", "url": SNAKEMAKE}
    engine["softwareVersion"] = version("snakemake")
    snakemake = crate.add(ContextEntity(crate, SNAKEMAKE, properties=engine))
    controls = []
    for number, job in enumerate(jobs):
        action = _action(crate, f"#job/{number}", f"{job.rule} {_part(job)}".rstrip(), [job])
        action["instrument"] = crate.get(f"#rule/{job.rule}")
        _link(action, "object", [files[path] for path in _data(job)])
        _link(action, "result", [files[path] for path in job.outputs])
        control = {"@type": "ControlAction", "name": f"Snakemake ran {action['name']}"}
        entity = crate.add(ContextEntity(crate, f"#control/{number}", properties=control))
        entity["instrument"], entity["object"] = crate.get(f"#step/{job.rule}"), action
        controls.append(entity)
    run = _action(crate, "#run", f"Run of the study {study.name}", jobs)
    run["instrument"] = workflow
    _link(run, "object", [files[path] for path in (*given, settings)])
    _link(run, "result", [files[path] for path in sorted(made) if path != settings])
    organised = {"@type": "OrganizeAction", "name": f"Snakemake ran the study {study.name}"}
    entity = crate.add(ContextEntity(crate, "#organised", properties=organised))
    entity["instrument"], entity["result"], entity["object"] = snakemake, run, controls


def _action(crate: ROCrate, name: str, title: str, jobs: Sequence[Job]) -> Entity:
    """Add an action that covers the time of all given jobs, and mention it in the root of the crate."""
    facts = {
        "@type": "CreateAction",
        "name": title,
        "description": f"{title}, {len(jobs)} {'job' if len(jobs) == 1 else 'jobs'} of Snakemake",
        "startTime": min(job.started for job in jobs).isoformat(timespec="seconds"),
        "endTime": max(job.ended for job in jobs).isoformat(timespec="seconds"),
        "actionStatus": "http://schema.org/CompletedActionStatus",
    }
    action = crate.add(ContextEntity(crate, name, properties=facts))
    crate.root_dataset.append_to("mentions", action)
    return action


def _link(entity: Entity, key: str, others: Sequence[Entity]) -> None:
    """Link an entity to others by the property ``key``; JSON-LD writes a single value without a list."""
    if others:
        entity[key] = others[0] if len(others) == 1 else list(others)


def _code(job: Job, files: dict[str, Entity]) -> list[str]:
    """Return a job's script, its inputs that are code, and the library's modules that it may have run."""
    script = [job.script] if job.script else []
    inputs = [path for path in job.inputs if path.endswith((".py", ".ipynb")) and path in files]
    modules = [_name(path) for room in job.code for path in files_of(room)]
    return [*script, *inputs, *dict.fromkeys(modules)]


def _data(job: Job) -> list[str]:
    """Return the inputs of a job that are data."""
    return [path for path in job.inputs if not path.endswith((".py", ".ipynb"))]


def _part(job: Job) -> str:
    """Return what distinguishes a job from others of its rule: its log's name, unless that is the rule's."""
    name = Path(job.logs[0]).stem if job.logs else ""
    return "" if name == job.rule else name


def _name(path: Path) -> str:
    """Return the path of a file in the crate.

    It is the path relative to the project or to the working folder. Files from elsewhere are in ``inputs``,
    each in a folder that a digest of its content names, because two of them may have the same name.
    InputError is raised if the file no longer exists.
    """
    if not path.is_file():
        raise InputError(
            str(path), seen="no such file", expected="a file of the study", change="Run the study again."
        )
    for root in (PROJECT, Path.cwd()):
        if path.resolve().is_relative_to(root.resolve()):
            return path.resolve().relative_to(root.resolve()).as_posix()
    return f"inputs/{file_digest(path)[:10]}/{path.name}"


def _files(path: Path) -> Iterator[Path]:
    """Yield a file, or the files in a folder."""
    inside = path.rglob("*") if path.is_dir() else [path]
    yield from (file for file in inside if file.is_file() and file.suffix != ".pyc")


def _installed() -> str:
    """Return the version of Python, the machine, and the versions of all packages, as text."""
    packages = sorted({f"{package.name}=={package.version}" for package in distributions()}, key=str.lower)
    return "\n".join([f"# Python {platform.python_version()}, {platform.platform()}", *packages, ""])
