"""Build backend of the wheel: maturin builds the module, cargo the program that lies beside it.

Both use the release profile and one target directory, so the crate is compiled once.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import maturin

ROOT = Path(__file__).resolve().parents[2]
# Maturin packs this folder; its path in pyproject.toml is relative to the project.
SCRIPTS = ROOT / "target" / "wheel" / "klasktron.data" / "scripts"

get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
get_requires_for_build_editable = maturin.get_requires_for_build_editable


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    """Write the metadata of the wheel."""
    # Maturin demands the folder of the program already here.
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    return maturin.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Build the wheel with the module and the program."""
    add_program()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build an editable wheel; the program is copied as it is now."""
    add_program()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


def add_program():
    """Build the program and copy it to where maturin packs it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    command = ["cargo", "build", "--release", "--package", "klasktron", "--bin", "klasktron"]
    try:
        subprocess.run(command, cwd=ROOT, check=True)
    except FileNotFoundError:
        sys.exit("cargo is not installed; get it from https://rustup.rs and install again")
    except subprocess.CalledProcessError as error:
        sys.exit(f"{' '.join(command)} ended with status {error.returncode}")
    shutil.rmtree(SCRIPTS, ignore_errors=True)
    SCRIPTS.mkdir(parents=True)
    name = "klasktron" + sysconfig.get_config_var("EXE")
    shutil.copy2(target / "release" / name, SCRIPTS / name)
