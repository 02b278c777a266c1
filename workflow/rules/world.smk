# World: how far the predictions agree with crashes that were counted on roads (beyond the paper).
#
# In: crash probabilities and rates of the vehicles; counted crashes of this project's data folder, data/crash_counts.
# Out: predicted and counted crash rates in one table.


rule count_crashes:
    """Compare the predicted crash rates of the vehicles with counted ones."""
    input:
        vehicles=result("laws", "vehicles.csv"),
        exposure=result("laws", "exposure.csv"),
        events=str(PROJECT / "data/crash_counts/hundred_car_events.tsv.gz"),
        published=str(PROJECT / "data/crash_counts/published_rates.csv"),
        library=modules_of("count_crashes.py"),
    output:
        counted=result("counted_crashes.csv"),
    log:
        log_of("count_crashes.log"),
    benchmark:
        benchmark_of("count_crashes.tsv")
    threads: 1
    resources:
        mem_mb=500,
    message:
        "Comparing predicted crash rates with counted ones"
    script:
        "../scripts/count_crashes.py"
