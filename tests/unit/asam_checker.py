"""What ASAM's own checker says of scenario files."""

from qc_baselib import Configuration, Result, StatusType
from qc_openscenario import constants
from qc_openscenario.main import run_checks


def verdict(path):
    """Return the completed checks by their names, and the issues in words."""
    settings, result = Configuration(), Result()
    settings.set_config_param(name="InputFile", value=str(path))
    settings.register_checker_bundle(checker_bundle_name=constants.BUNDLE_NAME)
    result.register_checker_bundle(
        name=constants.BUNDLE_NAME, description="", version=constants.BUNDLE_VERSION, summary=""
    )
    run_checks(settings, result)
    bundle = result.get_checker_results(constants.BUNDLE_NAME)
    completed = [checker.checker_id for checker in bundle if checker.status == StatusType.COMPLETED]
    issues = [f"{checker.checker_id}: {issue.description}" for checker in bundle for issue in checker.issues]
    return completed, issues
