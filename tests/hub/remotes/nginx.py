"""A real nginx on this machine: TLS with a certificate of its own authority, and byte ranges."""

import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Self

CONFIG = """
daemon off;
master_process off;
{user}
error_log {root}/error.log warn;
pid {root}/nginx.pid;
events {{ worker_connections 64; }}
http {{
  types {{ application/octet-stream bin; }}
  access_log {root}/access.log;
  client_body_temp_path {root}/body;
  proxy_temp_path {root}/proxy;
  fastcgi_temp_path {root}/fastcgi;
  uwsgi_temp_path {root}/uwsgi;
  scgi_temp_path {root}/scgi;
  server {{
    listen 127.0.0.1:{port} ssl;
    server_name localhost;
    ssl_certificate {root}/server.pem;
    ssl_certificate_key {root}/server.key;
    root {folder};
    {extra}
    rewrite ^/moved/(.*)$ https://localhost:{port}/$1 redirect;
    rewrite ^/plain/(.*)$ http://localhost:{port}/$1 redirect;
  }}
}}
"""

PROGRAM = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin:/usr/local/sbin")


def missing() -> str | None:
    """Why there can be no nginx here, None if there can."""
    if PROGRAM is None:
        return "needs nginx, in Debian: apt-get install nginx-light"
    if shutil.which("openssl") is None:
        return "needs openssl, for certificates"
    return None


def make_certificates(folder: Path) -> Path:
    """Makes an authority and a certificate of `localhost`; returns the authority's."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    names = folder / "names"
    names.write_text("subjectAltName=DNS:localhost\nbasicConstraints=CA:FALSE\n")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2")
    openssl("req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=test ca",
            "-addext", "keyUsage=critical,keyCertSign,cRLSign")  # fmt: skip
    openssl("req", *key[:-2], "-keyout", "server.key", "-out", "server.csr", "-subj", "/CN=x")
    openssl("x509", "-req", "-in", "server.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-days", "2",
            "-CAcreateserial", "-extfile", str(names), "-out", "server.pem")  # fmt: skip
    return folder / "ca.pem"


class Nginx:
    """Serves the files of `folder` over TLS.

    Args:
        folder: what is served.
        root: for its configuration, certificates and logs.
        extra: further directives of the server, such as `limit_rate 1;`.
    """

    def __init__(self, folder: Path, root: Path, extra: str = "") -> None:
        self.folder, self.root, self.extra = folder, root, extra
        root.mkdir()
        self.authority = make_certificates(root)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = int(free.getsockname()[1])

    @property
    def url(self) -> str:
        """By name, as its certificate says."""
        return f"https://localhost:{self.port}"

    def log(self) -> list[str]:
        """Its access log."""
        return (self.root / "access.log").read_text().splitlines()

    def __enter__(self) -> Self:
        assert PROGRAM is not None
        user = "user root;" if os.geteuid() == 0 else ""
        text = CONFIG.format(
            root=self.root, folder=self.folder, port=self.port, extra=self.extra, user=user
        )
        (self.root / "nginx.conf").write_text(text)
        command = [PROGRAM, "-p", str(self.root), "-c", str(self.root / "nginx.conf")]
        self._process = subprocess.Popen([*command, "-e", str(self.root / "error.log")])
        deadline = time.monotonic() + 300
        while True:
            with socket.socket() as attempt:
                if attempt.connect_ex(("127.0.0.1", self.port)) == 0:
                    return self
            assert self._process.poll() is None, (self.root / "error.log").read_text()
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._process.wait(300)
