"""A vehicle that is an FMU, compiled here from C: the car of the study, and one that misbehaves."""

import re
import shutil
import subprocess
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from accelerated_evaluation import InputError, load_vehicle
from accelerated_evaluation.laws.motion import MOTIONS, draw_lead_speeds
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.external import fmi
from accelerated_evaluation.vehicles.external.workers import Processes, simulate_batch

fmpy = pytest.importorskip("fmpy", reason="FMPy, the extra 'fmu', is not installed")
COMPILER = shutil.which("cc") or shutil.which("gcc")
SOURCE = Path(__file__).parents[1] / "car_fmu.c"
NAMES = ["gap", "range_rate", "host_speed", "acceleration", "trouble", "kmh"]
INPUTS = {"range": {"name": "gap"}, "range_rate": {}, "host_speed": {}}
FMU_UNITS = {"gap": "m"}
TROUBLES = {"hangs": 1, "aborts": 2, "refuses": 3, "no number": 4, "prints": 5, "ends": 6}

FMI2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="car" guid="{{car}}">
<CoSimulation modelIdentifier="car" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="m"/>{definitions}</UnitDefinitions>
<ModelVariables>{variables}</ModelVariables>
<ModelStructure><Outputs><Unknown index="4"/></Outputs></ModelStructure>
</fmiModelDescription>"""
FMI3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="car" instantiationToken="car">
<CoSimulation modelIdentifier="car" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="m"/>{definitions}</UnitDefinitions>
<ModelVariables>{variables}<Float64 name="time" valueReference="9" causality="independent"
variability="continuous"/></ModelVariables>
<ModelStructure><Output valueReference="3"/></ModelStructure>
</fmiModelDescription>"""


def described(version, definitions="", units=FMU_UNITS):
    """Return the model description, with definitions of units and the units of variables."""
    variables = ""
    for reference, name in enumerate(NAMES):
        causality = "output" if name == "acceleration" else "input"
        start = "" if causality == "output" else ' start="0"'
        unit = f' unit="{units[name]}"' if name in units else ""
        head = f'name="{name}" valueReference="{reference}" causality="{causality}"'
        variables += (
            f"<ScalarVariable {head}><Real{start}{unit}/></ScalarVariable>"
            if version == 2
            else f"<Float64 {head}{start}{unit}/>"
        )
    return (FMI2 if version == 2 else FMI3).format(variables=variables, definitions=definitions)


def unused(version, headers):
    """Return C code that defines the functions of FMI that the car has no use for."""
    declared = re.findall(
        rf"#define (fmi{version}\w+)\s+fmi{version}FullName",
        (headers / f"fmi{version}Functions.h").read_text(),
    )
    used = SOURCE.read_text()
    return "\n".join(f"int {name}(void) {{ return 3; }}" for name in declared if name not in used)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """Compile the car for both versions."""
    if COMPILER is None:
        pytest.skip("no C compiler is here to make the FMU")
    folder = tmp_path_factory.mktemp("fmu")
    headers = Path(fmpy.__file__).parent / "c-code"
    paths = {}
    for version, place in [(2, "linux64"), (3, "x86_64-linux")]:
        library, paths[version] = folder / f"car{version}.so", folder / f"car{version}.fmu"
        rest = folder / f"rest{version}.c"
        rest.write_text(unused(version, headers))
        flags = ["-shared", "-fPIC", "-O1", "-ffp-contract=off", f"-I{headers}", f"-DFMI{version}"]
        subprocess.run([COMPILER, *flags, SOURCE, rest, "-o", library, "-lm"], check=True)
        with zipfile.ZipFile(paths[version], "w") as archive:
            archive.writestr("modelDescription.xml", described(version))
            archive.write(library, f"binaries/{place}/car.so")
    return paths


def cut_ins(n=100):
    generator = np.random.default_rng(5)
    return generator.uniform(5, 15, n), generator.uniform(1, 25, n), generator.uniform(-4, 18, n)


@pytest.mark.parametrize("version", [2, 3])
def test_the_study_s_car_as_an_fmu_has_its_outcomes(fmus, version):
    fmu, own = load_vehicle("fmu", file=str(fmus[version]), inputs=INPUTS), load_vehicle("acc_aeb")
    got, wanted = fmu.simulate(*cut_ins()), own.simulate(*cut_ins())
    assert 0.1 < wanted.crash.mean() < 0.9
    for name in CUT_IN.outcome_names:
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-9, atol=1e-9)
    weak = load_vehicle("acc_only").simulate(*cut_ins())
    assert not np.allclose(got.min_range, weak.min_range, rtol=1e-3, atol=1e-3)


def test_an_fmu_takes_lead_motion(fmus):
    fmu, own = load_vehicle("fmu", file=str(fmus[2]), inputs=INPUTS), load_vehicle("acc_aeb")
    encounters = cut_ins(40)
    motion = draw_lead_speeds(MOTIONS["ngsim"](), np.array(encounters), np.random.default_rng(3))
    got, wanted = fmu.simulate_moving(*encounters, motion), own.simulate_moving(*encounters, motion)
    for name in CUT_IN.outcome_names:
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-9, atol=1e-9)
    still = own.simulate(*encounters)
    assert not np.allclose(got.min_range, still.min_range, rtol=1e-3, atol=1e-3)
    with pytest.raises(InputError, match=r"expected 40 rows of 81 speeds or more \(8 s\)"):
        fmu.simulate_moving(*encounters, motion[:, :60])


def test_the_trace_of_an_fmu_is_that_of_the_study_s_car_until_it_stands_or_crashes(fmus):
    fmu, own = load_vehicle("fmu", file=str(fmus[2]), inputs=INPUTS).vehicle, load_vehicle("acc_aeb")
    columns = ["time_s", "lead_position_m", "host_position_m", "host_speed_m_per_s", "range_m"]
    for place in ((10.0, 8.0, 12.0), (10.0, 30.0, 5.0)):
        got, wanted = fmu.trace(*place), own.trace(*place)
        assert got.columns.equals(wanted.columns)
        assert 3 < len(got) <= len(wanted)
        wanted = wanted.iloc[: len(got)]
        # The positions of the built-in car begin at the host's front too, and its lead vehicle at the range.
        np.testing.assert_allclose(got[columns[1:]], wanted[columns[1:]], rtol=1e-9, atol=1e-9)
        outcomes = own.simulate(*([value] for value in place))
        assert (got["range_m"].iloc[-1] <= 0) == outcomes.crash[0]
        assert got["range_m"].min() == pytest.approx(outcomes.min_range[0], abs=1e-9)


def test_units_are_those_of_the_configuration(fmus):
    inputs = INPUTS | {"host_speed": {"unit": "km/h"}}
    fmu = load_vehicle("fmu", file=str(fmus[2]), inputs=inputs, start={"kmh": 1})
    own = load_vehicle("acc_aeb").simulate(*cut_ins())
    np.testing.assert_allclose(fmu.simulate(*cut_ins()).min_range, own.min_range, rtol=1e-9, atol=1e-9)
    wrong = load_vehicle("fmu", file=str(fmus[2]), inputs=inputs)
    assert not np.allclose(wrong.simulate(*cut_ins()).min_range, own.min_range, rtol=1e-3, atol=1e-3)


KPH = '<Unit name="{}"><BaseUnit m="1" s="-1" factor="0.2777777777777778"/></Unit>'
DEFINITIONS = {
    "kph": KPH.format("kph"),
    "speed": KPH.format("speed"),
    "m/s": KPH.format("m/s"),
    "mm": '<Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>',
    "km/h": '<Unit name="km/h"/>',
    "kt": '<Unit name="kt"/>',
    "from 10": '<Unit name="from 10"><BaseUnit m="1" s="-1" factor="0.2777777777777778" offset="10"/></Unit>',
}


def with_units(fmu, path, version, unit):
    """Write an FMU whose host speed has a unit of `DEFINITIONS`."""
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content = described(version, "".join(DEFINITIONS.values()), FMU_UNITS | {"host_speed": unit})
            target.writestr(name, content if name.endswith(".xml") else source.read(name))
    return str(path)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("unit", "configured", "message"),
    [
        ("kph", {}, ""),
        ("speed", {}, ""),
        ("km/h", {}, ""),  # known, without a definition
        ("kph", {"unit": "km/h"}, ""),
        ("kph", {"unit": "kph"}, ""),
        ("kt", {"unit": "km/h"}, ""),  # without a definition, so the configuration decides
        ("kt", {}, r"host_speed\.unit: seen none here, and for host_speed the unit kt without a definition"),
        ("kph", {"unit": "m/s"}, "seen m/s; expected kph, as the FMU declares"),
        ("m/s", {}, ""),  # the definition in the FMU decides
        ("mm", {}, r"seen mm of \{'m': 1\} in the FMU; expected a unit of \{'m': 1, 's': -1\}"),
    ],
)
def test_the_unit_that_an_fmu_defines_is_used_or_refused(fmus, tmp_path, version, unit, configured, message):
    path = with_units(fmus[version], tmp_path / "a.fmu", version, unit)
    parameters = {"file": path, "inputs": INPUTS | {"host_speed": configured}, "start": {"kmh": 1}}
    if message:
        with pytest.raises(InputError, match=message):
            load_vehicle("fmu", **parameters)
        return
    own = load_vehicle("acc_aeb").simulate(*cut_ins())
    got = load_vehicle("fmu", **parameters).simulate(*cut_ins())
    np.testing.assert_allclose(got.min_range, own.min_range, rtol=1e-9, atol=1e-9)


def test_an_array_is_no_variable_of_the_car(fmus, tmp_path):
    with zipfile.ZipFile(fmus[3]) as source, zipfile.ZipFile(tmp_path / "a.fmu", "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name.endswith(".xml"):
                head, tail = content.decode().split('<Float64 name="gap"')
                own, rest = tail.split("/>", 1)
                content = f'{head}<Float64 name="gap"{own}><Dimension start="1"/></Float64>{rest}'
            target.writestr(name, content)
    with pytest.raises(
        InputError, match=r"inputs\.range\.name: seen gap, which is an array; expected a variable"
    ):
        load_vehicle("fmu", file=str(tmp_path / "a.fmu"), inputs=INPUTS)


def test_the_offset_of_a_unit_is_used(fmus, tmp_path):
    path = with_units(fmus[2], tmp_path / "a.fmu", 2, "from 10")
    speed = load_vehicle("fmu", file=path, inputs=INPUTS).vehicle._model.inputs[-1]
    assert (speed.factor, speed.offset) == pytest.approx((1 / 3.6, 10))
    # The car takes the number of the unit for m/s: 15 m/s are 18 of this unit.
    got = load_vehicle("fmu", file=path, inputs={**INPUTS}).vehicle.trace(10.0, 60.0, 5.0)
    wanted = load_vehicle("fmu", file=str(fmus[2]), inputs=INPUTS | {"host_speed": {}}).vehicle
    state = wanted._model.started(fmi.HostAndLead(60.0, 18.0, 13.0)).advance(
        0.0, 0.1, fmi.HostAndLead(60.0, 18.0, 13.0)
    )
    assert got["host_speed_m_per_s"].iloc[1] == pytest.approx(15 + 0.1 * state)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        ("refuses", "its step at 0.4 s: seen .*rror"),
        ("no number", "its step at 0.4 s: seen an acceleration of nan"),
        ("ends", "its step at 0.4 s: seen a request to end the simulation"),
    ],
)
def test_an_fmu_that_fails_names_encounter_and_time(fmus, version, trouble, message):
    if version == 2 and trouble == "ends":
        return  # FMI 2.0 has no such thing
    fmu = load_vehicle("fmu", file=str(fmus[version]), inputs=INPUTS, start={"trouble": TROUBLES[trouble]})
    place = r"car\d\.fmu, the encounter lead_speed 10, range 70, closing_speed 2, "
    with pytest.raises(InputError, match=place + message):
        fmu.simulate([10.0], [70.0], [2.0])


def test_an_fmu_that_prints_or_ends_its_process_leaves_the_others_alone(fmus, capfd):
    encounters = np.array([[10.0], [70.0], [2.0]])
    with Processes(2) as processes:
        futures = {
            trouble: processes.submit(
                simulate_batch,
                "fmu",
                {"file": str(fmus[2]), "inputs": INPUTS, "start": {"trouble": TROUBLES[trouble]}},
                encounters,
                60.0,
            )
            for trouble in ("aborts", "prints")
        }
        assert futures["prints"].result().shape == (4, 1)
        with pytest.raises(Exception, match="terminated abruptly"):
            futures["aborts"].result()
    assert "a line that nobody asked for" not in capfd.readouterr().out


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"file": "nowhere.fmu"}, "vehicle nowhere.fmu: seen no such file; expected an FMU"),
        ({"file": str(SOURCE)}, "seen a file that is no ZIP archive"),
        ({"inputs": {"range": {"name": "gapp"}}}, r"inputs.range.name: seen 'gapp'; .* Did you mean gap\?"),
        ({"inputs": {"rang": {}}}, r"inputs: seen 'rang'; .* Did you mean range\?"),
        (
            {"inputs": {"range": {"name": "gap", "unit": "miles"}}},
            "inputs.range.unit: seen 'miles'; .* m, km,",
        ),
        ({"inputs": {"range": {"name": "gap", "unit": "ft"}}}, "seen ft; expected m, as the FMU declares"),
        ({"inputs": {"range": {"name": "gap", "units": "m"}}}, "inputs.range: seen 'units'"),
        ({"inputs": {"range": "gap"}}, "inputs.range: seen 'gap'; expected a name and a unit"),
        ({"inputs": "gap"}, "vehicle parameter inputs: seen 'gap'; expected a dict"),
        ({"acceleration": {"name": "brake"}}, "parameters.acceleration.name: seen 'brake'"),
        ({"start": {"troubl": 1}}, r"start.troubl: seen 'troubl'; .* Did you mean trouble\?"),
        ({"step": 0}, "vehicle parameter step: seen 0; expected a positive number"),
        ({"duration": "long"}, "vehicle parameter duration: seen 'long'"),
        ({"stepp": 0.1}, "parameter 'stepp'"),
    ],
)
def test_fmus_that_cannot_be_used(fmus, parameters, message):
    with pytest.raises(InputError, match=message):
        load_vehicle("fmu", **{"file": str(fmus[2]), "inputs": INPUTS} | parameters)


def test_files_that_are_no_fmu_for_here(tmp_path, fmus):
    def packed(name, **contents):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for member, content in contents.items():
                archive.writestr(member.replace("__", "/"), content)
        return str(tmp_path / name)

    with pytest.raises(InputError, match="vehicle fmu: seen no parameter 'file'"):
        load_vehicle("fmu")
    with pytest.raises(InputError, match=r"seen KeyError.*; expected a valid FMU"):
        load_vehicle("fmu", file=packed("empty.fmu"))
    with pytest.raises(InputError, match="expected a valid FMU"):
        load_vehicle("fmu", file=packed("broken.fmu", **{"modelDescription.xml": "<a>"}))
    with pytest.raises(InputError, match=r"seen binaries for no platform; expected one for \w+"):
        load_vehicle("fmu", file=packed("nothing.fmu", **{"modelDescription.xml": described(2)}))
    exchange = (
        described(2)
        .replace("CoSimulation", "ModelExchange")
        .replace('canHandleVariableCommunicationStepSize="true"', "")
    )
    with pytest.raises(InputError, match=r"seen FMI 2\.0, not for co-simulation"):
        load_vehicle("fmu", file=packed("exchange.fmu", **{"modelDescription.xml": exchange}))


@pytest.mark.parametrize(
    ("declared", "step", "warns"),
    [("0.02", 0.1, False), ("0.03", 0.1, True), ("0.2", 0.1, True), (None, 0.1, False)],
)
@pytest.mark.parametrize("version", [2, 3])
def test_a_step_that_is_no_multiple_of_the_fmu_s_own_is_reported(tmp_path, version, declared, step, warns):
    """FMPy issue 699: an FMU with a fixed step of its own returns outdated or invalid values."""
    experiment = f'<DefaultExperiment stepSize="{declared}"/>' if declared else ""
    text = described(version).replace("<ModelVariables>", experiment + "<ModelVariables>")
    place = {2: "linux64", 3: "x86_64-linux"}[version]
    with zipfile.ZipFile(tmp_path / "car.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{place}/car.so", "")
    load = partial(load_vehicle, "fmu", file=str(tmp_path / "car.fmu"), inputs=INPUTS, step=step)
    if not warns:
        load()
        return
    with pytest.warns(UserWarning, match=rf"step of 0\.1 s is no multiple of {declared} s"):
        load()
