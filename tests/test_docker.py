"""What the images are made of, as far as that can be checked without a container."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from rtmp_server import RtmpServer

from app.config import PushSettings
from app.stream.push.target import push_target

DOCKER = Path(__file__).resolve().parent.parent / "docker"


def test_the_services_fit_together() -> None:
    services = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))["services"]
    for service in services.values():
        context = DOCKER / service["build"]["context"]
        assert (context / service["build"].get("dockerfile", "Dockerfile")).is_file()
    environment = services["mary"]["environment"]
    push = PushSettings(rtmp=environment["MARY_PUSH__RTMP"], rtmp_play=environment["MARY_PUSH__RTMP_PLAY"])
    host = push_target(f"{push.rtmp}/key").url.split("/")[2]
    assert host in services
    assert services[host]["ports"] == ["1935:1935"]
    configuration = (DOCKER / "rtmp" / "nginx.conf").read_text(encoding="utf-8")
    assert "listen 1935;" in configuration
    assert "application live {" in configuration


def test_nginx_takes_its_configuration(tmp_path: Path) -> None:
    if reason := RtmpServer.missing():
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)
    configuration = (DOCKER / "rtmp" / "nginx.conf").read_text(encoding="utf-8")
    (tmp_path / "nginx.conf").write_text(configuration.replace("/run/nginx.pid", str(tmp_path / "nginx.pid")))
    program = shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin")
    assert program is not None
    checked = subprocess.run(
        [program, "-t", "-p", str(tmp_path), "-c", str(tmp_path / "nginx.conf")], capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stderr
