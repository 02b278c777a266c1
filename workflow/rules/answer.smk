# Answer: laws of cut-ins that fit where crashes happen, and one crash probability with its interval (beyond the paper).
#
# In: encounters.parquet, the crash maps of the vehicle under test and of those that it is compared with. Out: the scores of
# all laws on records that they have not seen, their calibration, and the crash probability of every vehicle.

COMPARED = {
    name: description
    for name, parameters in config["compared_vehicles"].items()
    if (description := mapped(name, parameters)) != MAPPED
}

for _vehicle, _description in COMPARED.items():

    rule:
        name:
            f"map_crashes_of_{_vehicle}"
        input:
            library=modules_of("map_crashes.py", members={"vehicles": [_vehicle]}),
        output:
            half=map_of(_description, "crash_map/half.npz"),
            vehicle=map_of(_description, "vehicle.json"),
        log:
            map_of(_description, "logs/map_crashes.log"),
        benchmark:
            map_of(_description, "benchmarks/map_crashes.tsv")
        threads: 1
        resources:
            mem_mb=2000,
        params:
            mapped=_description,
        message:
            f"Mapping the crashes of {_vehicle}"
        script:
            "../scripts/map_crashes.py"
