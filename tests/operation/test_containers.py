"""The container files: hardened, checked for health, ending with a status; `make docker` runs them."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
SERVICES = COMPOSE["services"]
STAGES = re.split(r"^FROM ", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)[1:]
TARGETS = {stage.split(maxsplit=3)[2]: stage for stage in STAGES}
PROFILES = {"mock": {"server", "solid", "fluid"}, "openfoam": {"server", "flap"}}


def test_each_profile_has_its_services():
    found = {name: {s for s, service in SERVICES.items() if name in service["profiles"]} for name in PROFILES}
    assert found == PROFILES


@pytest.mark.parametrize("name", sorted(SERVICES))
def test_a_service_is_hardened(name):
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["pids_limit"] <= 512
    assert not {"ports", "privileged", "user"} & set(service)
    isolated = service.get("network_mode") == "none"
    assert isolated or [COMPOSE["networks"][network]["internal"] for network in service["networks"]] == [True]


@pytest.mark.parametrize("name", sorted(SERVICES))
def test_services_that_others_depend_on_have_a_health_check(name):
    for other, how in SERVICES[name].get("depends_on", {}).items():
        assert how == {"condition": "service_healthy"}
        assert SERVICES[other]["healthcheck"]["test"][0] == "CMD"
        assert set(SERVICES[name]["profiles"]) <= set(SERVICES[other]["profiles"])


def test_every_image_is_built_here_and_runs_without_rights():
    built = {service["image"]: service["build"]["target"] for service in SERVICES.values() if "build" in service}
    assert {service["image"] for service in SERVICES.values()} == set(built)
    for target in built.values():
        users = re.findall(r"^USER (\w+)", TARGETS[target], flags=re.MULTILINE)
        assert users[-1] == "mesh", target


def test_the_scripts_that_are_started_exist():
    started = [part for service in SERVICES.values() for part in service.get("command", []) if part.endswith(".py")]
    assert len(started) == 3
    for path in started:
        assert (ROOT / path.removeprefix("/src").lstrip("/")).is_file(), path


@pytest.mark.skipif(shutil.which("docker-compose") is None, reason="docker-compose is not installed")
@pytest.mark.parametrize("profile", sorted(PROFILES))
def test_compose_takes_the_file(profile):
    command = ["docker-compose", "--profile", profile, "config", "--services"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert PROFILES[profile] <= set(done.stdout.split())


def test_files_that_the_images_copy_are_not_ignored():
    """Files excluded by .dockerignore cannot be copied; it names the included ones."""
    taken = re.findall(r"^!(\S+)$", (ROOT / ".dockerignore").read_text(), flags=re.MULTILINE)
    copied = [
        name
        for line in re.findall(r"^COPY (?!--)(.+) \S+$", "".join(STAGES), flags=re.MULTILINE)
        for name in line.split()
    ]
    assert [name for name in copied if not any(name == let or name.startswith(f"{let}/") for let in taken)] == []
