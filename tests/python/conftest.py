"""What the tests of the Python module share: the recordings of `tests/data`, and the installed program."""

import os
import subprocess
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"


@pytest.fixture(scope="session")
def train():
    """Recording of motion for fits."""
    return DATA / "example-train.mcap"


@pytest.fixture(scope="session")
def validation():
    """Recording for validation."""
    return DATA / "example-validation.mcap"


@pytest.fixture(scope="session")
def match():
    """Recording of a match."""
    return DATA / "example-match.mcap"


@pytest.fixture(scope="session")
def program():
    """Runs the program that the wheel has installed, and demands one of the exit statuses `accepted`."""
    name = "klasktron" + sysconfig.get_config_var("EXE")
    path = Path(sysconfig.get_path("scripts")) / name
    assert path.exists(), f"the wheel has not installed {path}"

    def run(*arguments, accepted=(0,)):
        command = [path, *map(str, arguments)]
        environment = {key: own for key, own in os.environ.items() if key != "KLASKTRON_LOG"}
        found = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert found.returncode in accepted, found.stderr
        return found

    return run


@pytest.fixture(scope="session")
def actuator(program, train, tmp_path_factory):
    """A small fitted network, `actuator.mcap`."""
    folder = tmp_path_factory.mktemp("actuator")
    options = ["--epochs", 2, "--width", 16, "--hidden-layers", 2, "--seeds", 1]
    program("fit-actuator", train, "-o", folder, *options, accepted=(0, 3))
    return folder / "actuator.mcap"


@pytest.fixture(scope="session")
def twin_file(program, train, tmp_path_factory):
    """A calibrated twin, `twin.json`."""
    path = tmp_path_factory.mktemp("twin") / "twin.json"
    program("calibrate", train, "-o", path, accepted=(0, 3))
    return path


@pytest.fixture(scope="session")
def policy(program, tmp_path_factory):
    """A hardly trained policy, `policy.mcap`."""
    folder = tmp_path_factory.mktemp("policy")
    options = ["--steps", 500, "--envs", 16, "--hidden", 8, "--games", 0, "--quiet"]
    program("train", *options, "-o", folder, accepted=(0, 3))
    return folder / "policy.mcap"
