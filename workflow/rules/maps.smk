# Maps: crash maps up to closing speeds above which nothing changes, for laws without a cap on closing speeds.
#
# In: the vehicle under test and those that it is compared with. Out: a crash map of each, which studies share. In a
# study of a slow vehicle only those of the other vehicles that are fast to simulate have a map.


rule map_crashes_uncapped:
    """Compute the crash map of a vehicle up to closing speeds above which nothing changes."""
    input:
        vehicle=ancient(
            lambda wildcards: local(INPUTS.files[UNCAPPED[wildcards.mapped]])
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
    params:
        mapped=lambda wildcards: answered(UNCAPPED[wildcards.mapped]),
        # Only maps of the vehicle under test and of users' vehicles are checked against simulations.
        checked=lambda wildcards: UNCAPPED[wildcards.mapped] == "under_test"
        or bool(INPUTS.files[UNCAPPED[wildcards.mapped]]),
        vehicle=lambda wildcards: VEHICLES[UNCAPPED[wildcards.mapped]],
        simulations=lambda wildcards: INPUTS.simulating(UNCAPPED[wildcards.mapped])[1],
        library=code_up_to("crash_map", "scenarios", "vehicles"),
    message:
        "Mapping the crashes of {params.mapped[vehicle]} without a cap on closing speeds"
    script:
        "../scripts/map_crashes.py"
