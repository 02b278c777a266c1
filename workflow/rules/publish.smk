def published(kind):
    return [result("candidates.csv"),result("estimates.csv"),result("estimates_course.csv"),result("cross_entropy_trace.csv"),result("dependence.csv")]
