"""A real RTMP server for the tests: nginx with its RTMP module, set up, started, stopped and stalled at will."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

MODULE = Path("/usr/lib/nginx/modules/ngx_rtmp_module.so")
PATIENCE = 20.0
TOKEN = "open-sesame"

CONFIGURATION = """
load_module {module};
{user}
daemon off;
worker_processes 1;
error_log {folder}/error.log info;
pid {folder}/nginx.pid;
events {{ worker_connections 64; }}
rtmp {{
  server {{
    listen 127.0.0.1:{port};
    chunk_size 4096;
    notify_method get;
    application live {{ live on; }}
    application kept {{ live on; record all; record_path {folder}/kept; }}
    application locked {{ live on; on_publish http://127.0.0.1:{gate}/gate; }}
  }}
}}
http {{
  access_log off;
  client_body_temp_path {folder}/body;
  proxy_temp_path {folder}/proxy;
  fastcgi_temp_path {folder}/fastcgi;
  uwsgi_temp_path {folder}/uwsgi;
  scgi_temp_path {folder}/scgi;
  server {{
    listen 127.0.0.1:{gate};
    location /gate {{
      if ($arg_token = "{token}") {{ return 204; }}
      return 403;
    }}
  }}
}}
"""


class RtmpServer:
    """Applications: "live" takes everybody, "kept" records, "locked" only lets in who has `?token=open-sesame`.

    Attributes:
        folder: of its files.
        address: "127.0.0.1:port".
    """

    def __init__(self, folder: Path) -> None:
        for path in (folder, folder / "kept"):
            path.mkdir()
            path.chmod(0o777)
        self.folder = folder
        port, gate = _free_port(), _free_port()
        self.address = f"127.0.0.1:{port}"
        self._port = port
        self._process: subprocess.Popen[bytes] | None = None
        self._configuration = folder / "nginx.conf"
        user = "user root;" if os.geteuid() == 0 else ""
        self._configuration.write_text(
            CONFIGURATION.format(module=MODULE, user=user, folder=folder, port=port, gate=gate, token=TOKEN)
        )

    @staticmethod
    def missing() -> str:
        """What has to be installed, or ""."""
        if shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin") and MODULE.exists():
            return ""
        return "nginx with its RTMP module is not installed: apt-get install nginx libnginx-mod-rtmp"

    def url(self, name: str, application: str = "live") -> str:
        return f"rtmp://{self.address}/{application}/{name}"

    def kept(self, name: str) -> Path:
        """The recording of what was published as `name` to "kept"."""
        (found,) = (self.folder / "kept").glob(f"{name}*.flv")
        return found

    def start(self) -> None:
        program = shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin")
        assert program is not None
        self._process = subprocess.Popen(
            [program, "-p", str(self.folder), "-e", str(self.folder / "error.log"), "-c", str(self._configuration)],
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # its processes are a group, stopped and ended together
        )
        give_up = time.monotonic() + PATIENCE
        while True:
            try:
                socket.create_connection(("127.0.0.1", self._port), 1).close()
                return
            except OSError:
                assert self._process.poll() is None, (self.folder / "error.log").read_text()
                assert time.monotonic() < give_up, "nginx did not start"
                time.sleep(0.02)

    def pause(self) -> None:
        """It stands still; its kernel goes on taking connections and some data."""
        self._signal(signal.SIGSTOP)

    def resume(self) -> None:
        self._signal(signal.SIGCONT)

    def kill(self) -> None:
        """Gone at once; may be started again."""
        if self._process is not None:
            self._signal(signal.SIGKILL)
            self._process.wait()
            self._process = None

    def _signal(self, number: int) -> None:
        assert self._process is not None
        os.killpg(self._process.pid, number)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])
