"""An empty folder to run the program in, without settings from the environment."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from writing_jobs import make_inputs


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plain_settings: None) -> Path:
    """Make an empty folder the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def job_inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the inputs of all writing jobs once."""
    place, before = tmp_path_factory.mktemp("inputs"), Path.cwd()
    os.chdir(place)
    make_inputs(place)
    os.chdir(before)
    return place


@pytest.fixture
def job_folder(folder: Path, job_inputs: Path) -> Path:
    """Link the inputs of all writing jobs into the current folder."""
    shutil.copytree(job_inputs, folder, copy_function=os.link, dirs_exist_ok=True)
    return folder
