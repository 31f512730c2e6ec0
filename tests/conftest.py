"""What several test modules need and takes long to make: once in a test run.

Tests read these folders and write elsewhere. Imports stand in the fixtures, as this module is
loaded in any test run, of whatever tests.
"""

import pytest
from hypothesis import settings

# a property holds on a busy machine too
settings.register_profile("mtpipe", deadline=None)
settings.load_profile("mtpipe")


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden", action="store_true", help="write golden files instead of comparing"
    )


@pytest.fixture(scope="session")
def scan(tmp_path_factory):
    from tests.tracked_film import make_scan

    return make_scan(tmp_path_factory.mktemp("scan"))


@pytest.fixture(scope="session")
def tracked(tmp_path_factory, scan):
    from tests.tracked_film import make_film

    return make_film(tmp_path_factory.mktemp("film"), scan)
