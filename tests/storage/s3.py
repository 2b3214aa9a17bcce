"""An S3 server on this machine, in a process of its own, and the objects in its bucket."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import boto3

BUCKET = "lab"
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
PATIENCE_S = 60.0  # it answers within seconds
# Takes a free port, says which, and serves until its standard input closes.
SERVER = """
import sys
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
server.start()
print(server.get_host_and_port()[1], flush=True)
sys.stdin.read()
server.stop()
"""


class LocalS3:
    """A running server with an empty bucket; it logs every request."""

    def __init__(self, log: Path) -> None:
        self.log = log
        with log.open("wb") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-c", SERVER],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                text=True,
            )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())
        self.url = f"http://127.0.0.1:{self.port}"
        self.bucket: Any = boto3.resource(
            "s3",
            endpoint_url=self.url,
            region_name="us-east-1",
            aws_access_key_id="key",
            aws_secret_access_key="secret",
        ).Bucket(BUCKET)
        self.bucket.create()

    def __enter__(self) -> "LocalS3":
        return self

    def __exit__(self, *_: object) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(PATIENCE_S)

    def environment(self) -> dict[str, str]:
        """Return the variables by which Snakemake's plugin finds the server."""
        prefix = "SNAKEMAKE_STORAGE_S3"
        return {
            f"{prefix}_ENDPOINT_URL": self.url,
            f"{prefix}_ACCESS_KEY": "key",
            f"{prefix}_SECRET_KEY": "secret",
        }

    def upload(self, file: Path, key: str) -> None:
        """Copy a file into the bucket."""
        self.bucket.upload_file(str(file), key)

    def download(self, prefix: str, folder: Path) -> None:
        """Copy all objects below a prefix into a folder."""
        for key in self.keys(prefix):
            place = folder / os.path.relpath(key, prefix)
            place.parent.mkdir(parents=True, exist_ok=True)
            self.bucket.download_file(key, str(place))

    def keys(self, prefix: str) -> list[str]:
        """Return the names of all objects below a prefix."""
        return [found.key for found in self.bucket.objects.filter(Prefix=f"{prefix}/")]

    def requests(self) -> list[str]:
        """Return all requests so far, as ``GET /bucket/key``."""
        lines = COLOUR.sub("", self.log.read_text(errors="replace")).splitlines()
        return [line.split('"')[1].rpartition(" ")[0] for line in lines if '"' in line and "HTTP/1" in line]
