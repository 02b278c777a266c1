# Maps for laws without a cap: where each vehicle crashes, up to closing speeds where nothing changes any more.
#
# In: the vehicle under test and those that it is compared with. Out: a crash map of each, which studies share. In a study
# of a slow vehicle only the others are mapped, as far as they are fast.

# The folder of the map of each vehicle, which other studies of the same vehicle share, and the vehicle of each folder.
# Vehicles whose outcomes are stored are too slow for a map in a study of a slow vehicle.
MAPPED_VEHICLES = [name for name in VEHICLES if not (SLOW and INPUTS.is_slow(name))]
FOLDERS = {name: map_folder(answered(name)) for name in MAPPED_VEHICLES}
UNCAPPED = {Path(folder).name: name for name, folder in FOLDERS.items()}
ALL_FILES, ALL_CONTENT = INPUTS.files_of(*VEHICLES), INPUTS.content_of(*VEHICLES)
ALL_WORKERS, ALL_SIMULATIONS = INPUTS.simulating(*VEHICLES)
OF_VEHICLES = {"vehicles": [section["name"] for section in VEHICLES.values()]}


rule map_crashes_uncapped:
    """Map where a vehicle crashes up to closing speeds where nothing changes, because the laws have no cap."""
    input:
        vehicle=ancient(lambda wildcards: INPUTS.files[UNCAPPED[wildcards.mapped]]),
        library=modules_of(
            "map_crashes.py",
            members=lambda wildcards: {
                "vehicles": [VEHICLES[UNCAPPED[wildcards.mapped]]["name"]]
            },
        ),
    output:
        full="results/vehicles/{mapped}/crash_map/full.npz",
        vehicle="results/vehicles/{mapped}/vehicle.json",
    log:
        "results/vehicles/{mapped}/logs/map_crashes.log",
    benchmark:
        "results/vehicles/{mapped}/benchmarks/map_crashes_uncapped.tsv"
    wildcard_constraints:
        mapped="|".join(UNCAPPED),
    priority: 80
    threads: lambda wildcards: INPUTS.simulating(UNCAPPED[wildcards.mapped])[0]
    resources:
        mem_mb=2000,
    params:
        mapped=lambda wildcards: answered(UNCAPPED[wildcards.mapped]),
        # The maps of built-in vehicles are known; one of them has random closing speeds in the answer.
        checked=lambda wildcards: UNCAPPED[wildcards.mapped] == "under_test"
        or bool(INPUTS.files[UNCAPPED[wildcards.mapped]]),
        vehicle=lambda wildcards: VEHICLES[UNCAPPED[wildcards.mapped]],
        simulations=lambda wildcards: INPUTS.simulating(UNCAPPED[wildcards.mapped])[1],
    message:
        "Mapping the crashes of {params.mapped[vehicle]} without a cap on closing speeds"
    script:
        "../scripts/map_crashes.py"
