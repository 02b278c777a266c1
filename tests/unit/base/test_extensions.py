"""Members of registries that live in a folder or a package of their user, and faulty ones."""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation import InputError
from accelerated_evaluation.answer.ways.choice import draws_named
from accelerated_evaluation.base import extensions
from accelerated_evaluation.base.extensions import added
from accelerated_evaluation.laws import LAWS
from accelerated_evaluation.laws.distributions.described import DISTRIBUTIONS
from accelerated_evaluation.laws.motion import MOTIONS, draw_lead_speeds
from accelerated_evaluation.laws.paper.piecewise import PieceFamily
from accelerated_evaluation.laws.smooth.shapes import SHAPES
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.publishing import figures
from accelerated_evaluation.publishing.published import ALWAYS, FIGURES, figure, results_of, show
from accelerated_evaluation.publishing.study import Study
from accelerated_evaluation.records.checks import CHECKS, Records, inspect_records
from accelerated_evaluation.records.sources import read_source
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.study.configuration import load, load_modules
from accelerated_evaluation.study.dependencies import code_up_to, digest_of
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import VEHICLES

TOYS = Path(__file__).parents[2] / "toys/mine"
CHECK = """
from accelerated_evaluation.records.checks import CHECKS

@CHECKS.add({name!r})
def found(records):
    {body}
"""
# Modules that cannot be used, and what the message says of them.
BROKEN = {
    "a law that is no law": (
        "from accelerated_evaluation.laws import LAWS\n@LAWS.add('bad')\nclass Bad:\n    pass\n",
        "law 'bad': seen the class Bad; expected a class that derives from "
        "accelerated_evaluation.laws.protocol.Law. Correct it;",
    ),
    "a law without methods": (
        "from accelerated_evaluation.laws import LAWS, Law\n@LAWS.add('bad')\nclass Bad(Law):\n"
        "    def log_density(self, x): ...\n    def content(self): ...\n",
        "seen the class Bad without from_content, from_normal_scores; expected all attributes of",
    ),
    "a method without a style": (
        "from accelerated_evaluation.methods import METHODS, Method\n@METHODS.add('bad')\n"
        "class Bad(Method):\n    def estimate(self, problem, stopping, generator): ...\n",
        "method 'bad': seen the class Bad without style; expected all attributes of",
    ),
    "a distribution without a tail": (
        "from accelerated_evaluation.laws.distributions.described import Described, distribution\n"
        "from dataclasses import dataclass\n@distribution('bad')\n@dataclass(frozen=True)\n"
        "class Bad(Described):\n    lower: float\n    upper: float\n"
        "    def logpdf(self, x): ...\n    cdf = sf = ppf = mean = rvs = logpdf\n",
        "distribution 'bad': seen the class Bad without isf, logsf; expected all attributes of",
    ),
    "a scenario that is a text": (
        "from accelerated_evaluation.scenarios import SCENARIOS\nSCENARIOS.add('bad')('a text')\n",
        "scenario 'bad': seen the str a text; expected an instance of "
        "accelerated_evaluation.scenarios.protocol.Scenario.",
    ),
    "a name of the library": (
        CHECK.format(name="drift", body="..."),
        "check 'drift': seen two members of this name; expected a name of its own for each member.",
    ),
    "nothing": ("a = 1\n", "members: seen none; expected at least one decorator"),
    "a module of another folder": (
        "import not_to_be_found\n",
        "Install the module, or add its folder to the environment variable PYTHONPATH.",
    ),
    "a fault": ("1 / 0\n", "seen ZeroDivisionError: division by zero; expected a file that Python can"),
    "an end": ("import sys\nsys.exit(3)\n", "seen SystemExit: 3; expected a file that Python can import."),
    "an end of the process": ("raise SystemExit(0)\n", "seen SystemExit: 0; expected"),
}


@pytest.fixture(autouse=True)
def own_registries(monkeypatch):
    """Remove what a test has registered."""
    monkeypatch.setenv(extensions.VARIABLE, "")
    before = set(extensions.EXTENSIONS)
    yield
    forget(before)


def forget(before):
    """Remove the members of all extensions but those named."""
    for name in extensions.EXTENSIONS.keys() - before:
        for registry, member in extensions.EXTENSIONS.pop(name).members:
            registry.remove(member)
    os.environ[extensions.VARIABLE] = ""
    digest_of.cache_clear()


@pytest.mark.parametrize("fault", BROKEN)
def test_a_module_that_cannot_be_used_is_refused_and_leaves_nothing(tmp_path, fault):
    content, message = BROKEN[fault]
    known = set(LAWS), set(CHECKS), set(DISTRIBUTIONS)
    (tmp_path / "mine.py").write_text(content)
    (tmp_path / "study.yaml").write_text("modules: [mine.py]\n")
    with pytest.raises(InputError) as error:
        load([tmp_path / "study.yaml"])
    assert str(error.value).startswith(f"modules, {tmp_path}/mine.py")
    assert message in str(error.value)
    assert (set(LAWS), set(CHECKS), set(DISTRIBUTIONS)) == known
    assert str(tmp_path / "mine.py") not in extensions.EXTENSIONS
    (tmp_path / "mine.py").write_text(CHECK.format(name="corrected", body="return 1"))
    load([tmp_path / "study.yaml"])
    assert CHECKS["corrected"](None) == 1


# The beginning of a module with a check, a source or a figure of the name mine.
HEADS = {
    "check": "from accelerated_evaluation.records.checks import CHECKS, Finding\n@CHECKS.add('mine')\n",
    "source": "import pandas as pd\nfrom accelerated_evaluation.records.sources import source\n"
    "@source('mine', description='mine', files='file')\n",
    "figure": "import matplotlib.pyplot as plt\n"
    "from accelerated_evaluation.publishing.published import figure\n@figure\n",
}
BODIES = {  # of methods that fail, and how the messages about them end
    "1 / 0": ": seen ZeroDivisionError: division by zero; expected a function that returns ",
    "import sys; sys.exit(0)": ": seen SystemExit: 0; expected a function that returns ",
    "return None": ", value that it returned: seen None; expected ",
}
LAW = """
from accelerated_evaluation.laws.joint.copula import GaussianCopula
from accelerated_evaluation.laws.distributions import BoundedExponential
from accelerated_evaluation.laws.distributions.described import distribution
from accelerated_evaluation.laws.motion import MOTIONS
from accelerated_evaluation.laws.smooth.shapes import SHAPES, Exponential
from accelerated_evaluation.laws import FITS, LAWS
from accelerated_evaluation.methods import METHODS, Method
class Of(Method):
    style = {{}}
    @classmethod
    def configured(cls, sections): {body}
    def estimate(self, problem, stopping, generator): {body}
class Motion:
    inputs = 1
    def lead_speeds(self, encounters, inputs): {body}
class Excess(Exponential):
    def inverse(self, level, parameters): {body}
class Bounded(BoundedExponential):
    @classmethod
    def fit(cls, x, lower, upper): {body}
    def cdf(self, x): {body}
class Copula(GaussianCopula):
    candidates = {{}}
    @classmethod
    def fit(cls, x, box, generator, **more): {body}
def fitted(encounters, settings): {body}
"""
X = np.ones((4, 1))
# Members of the kinds whose methods are called in many places: how they are added and used.
CALLED = {
    "law": ("LAWS.add('mine')(Copula)", lambda: LAWS["mine"].fit(X, None, None)),
    "method": ("METHODS.add('mine')(Of)", lambda: METHODS["mine"]().estimate(None, None, None)),
    "method, learning": ("METHODS.add('mine')(Of)", lambda: METHODS["mine"].configured({})),
    "lead motion": ("MOTIONS.add('mine')(Motion)", lambda: draw_lead_speeds(MOTIONS["mine"](), X, RANDOM)),
    "tail shape": ("SHAPES.add('mine')(Excess())", lambda: SHAPES["mine"].inverse(X, X)),
    "distribution": ("distribution('mine')(Bounded)", lambda: PieceFamily("mine").fit(X[:, 0], 0.0, 9.0)),
    "distribution, cdf": ("distribution('mine')(Bounded)", lambda: DISTRIBUTIONS["mine"](1.0, 0, 9).cdf(X)),
    "law, fitted": ("FITS.add('mine')(fitted)", lambda: draws_named("mine", RECORDS, SETTINGS)),
}
RANDOM = np.random.default_rng(1)
RECORDS = SimpleNamespace(in_clusters=False, table=None)
SETTINGS = SimpleNamespace(streams=lambda name: RANDOM, fitting=None)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("kind", CALLED)
def test_a_method_of_a_user_that_fails_is_named(tmp_path, kind, body):
    add, use = CALLED[kind]
    (tmp_path / "mine.py").write_text(f"{LAW.format(body=body)}{add}\n")
    extensions.load_files([tmp_path / "mine.py"])
    with pytest.raises(InputError) as error:
        use()
    place = rf"{kind.split(',')[0]} mine, the function \w+ in {tmp_path}/mine\.py"
    assert re.match(place + re.escape(BODIES[body]), str(error.value)), str(error.value)


# Members that are registered and then fail when they are used, and what the message says of them.
FAILING = [
    ("check", "def mine(records): 1 / 0", ": seen ZeroDivisionError: division by zero; expected a function"),
    ("check", "def mine(records): ...", ", value that it returned: seen None; expected a Finding. Correct"),
    (
        "check",
        "def mine(records): return Finding('bad', '', '', 1)",
        ", Finding, argument verdict: seen 'bad'; expected one of fine, warning, stop.",
    ),
    (
        "check",
        "def mine(records): return Finding('fine', number=1)",
        ", Finding: seen missing a required argument: 'looked_at'; expected Finding(verdict, looked_at,",
    ),
    ("source", "def mine(settings): settings['file']", ": seen KeyError: 'file'; expected a function that"),
    (
        "source",
        "def mine(settings): return [1.0]",
        ", value that it returned: seen [1.0]; expected a table with the columns lead_speed, range and",
    ),
    (
        "source",
        "def mine(settings): return pd.DataFrame({'range': [1.0]})",
        ", value that it returned: seen a DataFrame with the columns range; expected a table with the",
    ),
    ("figure", "def mine(source): 1 / 0", ": seen ZeroDivisionError: division by zero; expected a function"),
    (
        "figure",
        "def mine(source): return plt.figure()",
        ", value that it returned: seen a Figure; expected a Matplotlib figure and the table of its data.",
    ),
    (
        "figure",
        "def mine(source): return plt.figure(), 3",
        ", value that it returned: seen a tuple; expected a Matplotlib figure and the table of its data.",
    ),
]


def use_of(kind, folder):
    """Use the member of the name mine as a study does."""
    if kind == "check":
        table = pd.DataFrame({"speed": np.linspace(1.0, 20.0, 200) ** 1.5})
        inspect_records(Records({"speed": "m/s"}, {"speed": (0.0, 99.0)}, table, table, table.index[:0]))
    elif kind == "source":
        read_source({"source": "mine", "mine": {"path": "a"}, "sample": None}, np.random.default_rng(1))
    else:
        (folder / "contents.json").write_text("[]")
        (folder / "config.json").write_text(json.dumps(load()))
        show(Study(folder, folder), FIGURES["mine"])


@pytest.mark.parametrize(("kind", "function", "message"), FAILING)
def test_a_member_that_fails_when_it_is_used_is_named(tmp_path, kind, function, message):
    (tmp_path / "mine.py").write_text(f"{HEADS[kind]}{function}\n")
    extensions.load_files([tmp_path / "mine.py"])
    with pytest.raises(InputError) as error:
        use_of(kind, tmp_path)
    assert str(error.value).startswith(f"{kind} mine, the function mine in {tmp_path}/mine.py{message}")


def test_a_fault_of_the_library_keeps_its_traceback(monkeypatch):
    """Only code of others is reported in one line; the message of a fault of ours would hide its place."""

    def mine(records):
        return 1 / 0

    mine.__module__ = "accelerated_evaluation.records.checks.mine"
    monkeypatch.setitem(CHECKS._members, "mine", mine)
    with pytest.raises(ZeroDivisionError):
        use_of("check", None)


def test_a_figure_is_a_function():
    with pytest.raises(InputError, match=r"figure, argument make: seen 3; expected a function\."):
        figure(3)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ("mine.py", 'modules: seen "mine.py"; expected a list of Python files. Write, for example'),
        ([3], "modules: seen [3]; expected a list of Python files."),
        (["none.py"], "modules: seen no file none.py in here or .; expected a Python file, relative to the"),
    ],
)
def test_a_key_that_names_no_files_is_refused(named, message):
    with pytest.raises(InputError) as error:
        load_modules({"modules": named}, ["here/study.yaml"])
    assert str(error.value).startswith(message)


def test_a_path_begins_in_the_folder_of_the_configuration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text(CHECK.format(name=folder, body=f"return {folder!r}"))
    load_modules({"modules": ["mine.py"]}, ["one/study.yaml"])
    assert "one" in CHECKS
    assert "other" not in CHECKS
    load_modules({"modules": ["mine.py"]}, ["one/study.yaml", "other/more.yaml"])
    assert CHECKS["other"](None) == "other"


def test_a_finished_study_brings_its_modules(tmp_path, monkeypatch):
    """The stored paths begin in the folder in which the study ran, wherever it is opened."""
    for folder in ("ran/settings", "ran/results/one", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "ran/mine.py").write_text(CHECK.format(name="mine", body="return 5"))
    (tmp_path / "ran/settings/study.yaml").write_text("modules: [../mine.py]\n")
    monkeypatch.chdir(tmp_path / "ran")
    config = load(["settings/study.yaml"])
    assert config["modules"] == ["mine.py"]
    Path("results/one/config.json").write_text(json.dumps(config))
    forget(set())
    assert "mine" not in CHECKS
    monkeypatch.chdir(tmp_path / "elsewhere")
    study = Study("../ran/results/one", "../ran/figures/one")
    assert CHECKS["mine"](None) == 5
    assert study.used.reads == []
    forget(set())
    (tmp_path / "ran/mine.py").unlink()
    with pytest.raises(InputError, match=r"modules: seen no file mine.py in \.\./ran or \."):
        Study("../ran/results/one", "../ran/figures/one")


def test_a_module_counts_as_code_of_the_rooms_to_which_it_adds(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(CHECK.format(name="mine", body="return 1"))
    before = code_up_to("base"), code_up_to("records"), code_up_to("laws")
    load_modules({"modules": ["mine.py", str(TOYS / "toy_shape.py")]}, [])
    shape = os.path.relpath(TOYS / "toy_shape.py")
    assert code_up_to("base") == before[0]
    assert code_up_to("records").keys() - before[1].keys() == {"mine.py"}
    assert code_up_to("laws").keys() - before[2].keys() == {"mine.py", shape}
    assert code_up_to("laws", "records").keys() - before[2].keys() == {"mine.py"}
    assert code_up_to("laws", "laws").keys() - before[2].keys() == {shape}
    assert code_up_to("laws", "laws/smooth").keys() - before[2].keys() == {shape}
    assert code_up_to("laws", "records/checks/mine").keys() - before[2].keys() == {"mine.py"}
    for other in ("laws/distributions", "laws/smoo", "records/sources", "records/checks/min"):
        assert code_up_to("laws", other) == before[2]
    first = code_up_to("records")["mine.py"]
    Path("mine.py").write_text(CHECK.format(name="mine", body="return 2"))
    digest_of.cache_clear()
    assert code_up_to("records")["mine.py"] != first


def test_the_results_of_a_figure_of_a_user_are_known_by_its_parameters(tmp_path):
    assert added(figures.__name__) == []
    (tmp_path / "mine.py").write_text(
        "from accelerated_evaluation.publishing.published import figure\n"
        "@figure\ndef mine(anwser, source): ...\n"
    )
    extensions.load_files([TOYS / "toy_figure.py", tmp_path / "mine.py"])
    assert added(figures.__name__) == ["mine", "toy_figure"]
    assert set(results_of("toy_figure")) == {*ALWAYS, "laws/answer.csv"}
    with pytest.raises(InputError, match="figure mine, parameter anwser: seen no such result"):
        results_of("mine")


def test_members_of_the_library_that_a_module_imports_first_are_not_its_own(tmp_path):
    """The module imports a law of the library, whose decorator then runs while the module is imported."""
    (tmp_path / "mine.py").write_text(
        "from accelerated_evaluation.laws.joint import kernel, copula\n"
        + CHECK.format(name="mine", body="return 1")
    )
    (tmp_path / "main.py").write_text(
        "from pathlib import Path\n"
        "from accelerated_evaluation.base.extensions import EXTENSIONS, load_files\n"
        "load_files([Path('mine.py')])\n(found,) = EXTENSIONS.values()\n"
        "print([name for _, name in found.members], found.adds_to('records'), found.adds_to('laws'))\n"
    )
    run = subprocess.run([sys.executable, "main.py"], cwd=tmp_path, capture_output=True, text=True)
    assert run.stdout == "['mine'] True False\n", run.stderr


def test_a_process_of_a_study_trusts_the_check_of_its_names_and_imports_no_other_member(tmp_path):
    """The process that read the configuration has made the check, and has imported all members for it."""
    (tmp_path / "mine.py").write_text(CHECK.format(name="mine", body="return 1"))
    (tmp_path / "study.yaml").write_text("modules: [mine.py]\n")
    (tmp_path / "main.py").write_text(
        "import sys\nfrom accelerated_evaluation.records.checks import CHECKS\n"
        "from accelerated_evaluation.study.configuration import load\nload(['study.yaml'])\n"
        "print(CHECKS['mine'](None), 'accelerated_evaluation.records.checks.units' in sys.modules)\n"
    )
    for known, printed in ((str(tmp_path / "mine.py"), "1 False\n"), ("", "1 True\n")):
        here = os.environ | {extensions.VARIABLE: known}
        run = [sys.executable, "main.py"]
        found = subprocess.run(run, cwd=tmp_path, env=here, capture_output=True, text=True)
        assert found.stdout == printed, found.stderr


def test_an_installed_package_adds_members_by_its_entry_point(tmp_path):
    """In a process of its own: the registry finds a package that nobody imports."""
    package, metadata = tmp_path / "their_cars", tmp_path / "their_cars-1.0.dist-info"
    package.mkdir()
    metadata.mkdir()
    (package / "__init__.py").write_text("from their_cars import checks\n")
    (package / "checks.py").write_text(CHECK.format(name="theirs", body="return 7"))
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: their-cars\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[accelerated_evaluation]\ncars = their_cars\n")
    (tmp_path / "main.py").write_text(
        "from accelerated_evaluation.records.checks import CHECKS\n"
        "from accelerated_evaluation.study.dependencies import code_up_to\n"
        "print(CHECKS['theirs'](None), 'theirs' in list(CHECKS))\n"
        "print(sorted(code_up_to('records').keys() - code_up_to('base').keys()))\n"
    )
    here = os.environ | {"PYTHONPATH": str(tmp_path)}
    run = subprocess.run([sys.executable, "main.py"], cwd=tmp_path, env=here, capture_output=True, text=True)
    assert run.stdout == "7 True\n['package their-cars, entry point cars', 'records']\n", run.stderr
    (package / "checks.py").write_text(CHECK.format(name="drift", body="return 7"))
    run = subprocess.run([sys.executable, "main.py"], cwd=tmp_path, env=here, capture_output=True, text=True)
    message = "package their-cars, entry point cars, check 'drift': seen two members of this name"
    assert message in run.stderr
    # Only commands that need all members of a kind end.
    for named, status in (
        (["--version"], 0),
        (["--help"], 0),
        (["simulate", "-h"], 0),
        (["inspect", str(TOYS.parents[2] / "config/left_turn.yaml")], 2),
    ):
        command = [sys.executable, "-m", "accelerated_evaluation.cli", *named]
        run = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True)
        lines = run.stderr.splitlines()
        assert (run.returncode, len(lines)) == (status, 1 + (status > 0)), run.stderr
        assert lines[0].startswith(f"warning: {message}")
        assert status == 0 or lines[1].startswith(f"error: {message}")


def test_a_module_may_contain_a_vehicle_that_is_named_by_its_class(tmp_path):
    """Its file is not imported a second time, which would register its members twice."""
    (tmp_path / "car.py").write_text((TOYS / "toy_car.py").read_text().replace("toy_car", "other_car"))
    (tmp_path / "study.yaml").write_text("modules: [car.py]\n")
    load([tmp_path / "study.yaml"])
    path = f"{tmp_path}/car.py:ToyCar"
    loaded = [load_vehicle(path, CUT_IN, deceleration=each).vehicle for each in (2.0, 4.0)]
    assert [type(each) for each in loaded] == [VEHICLES["other_car"]] * 2


@pytest.mark.parametrize("file", sorted(TOYS.glob("*.py")), ids=lambda file: file.stem)
def test_the_guide_shows_a_file_of_each_kind_that_the_tests_run(file):
    guide = (TOYS.parents[2] / "docs/extensions.md").read_text()
    assert f"`{file.name}`, a" in guide
    assert f"```python\n{file.read_text()}```\n" in guide


def test_a_shape_and_a_joint_law_of_a_user_are_candidates(tmp_path):
    (tmp_path / "main.py").write_text(
        "from accelerated_evaluation.laws.smooth.family import members_at\n"
        "from accelerated_evaluation.answer.candidates.joint_family import candidates\n"
        "print([each.name for each in members_at([0.9]) if 'toy' in each.name])\n"
        "print([each.name for each in candidates() if 'toy' in each.name])\n"
    )
    files = [str(TOYS / "toy_shape.py"), str(TOYS / "toy_copula.py")]
    here = os.environ | {extensions.VARIABLE: os.pathsep.join(files)}
    run = subprocess.run([sys.executable, "main.py"], cwd=tmp_path, env=here, capture_output=True, text=True)
    assert run.stdout == "['toy shape 0.9']\n['toy copula']\n", run.stderr


def test_an_import_that_takes_long_is_reported(monkeypatch, capsys):
    monkeypatch.setattr(extensions, "PATIENCE", 0.01)
    with pytest.raises(InputError, match="members: seen none"):
        extensions._add(extensions.Extension("slow", [Path("slow.py")]), lambda: time.sleep(0.5))
    assert "waiting: slow is being imported" in capsys.readouterr().err
