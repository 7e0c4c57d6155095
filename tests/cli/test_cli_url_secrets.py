"""Secrets in URLs reach the server, and neither results nor messages."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pyarrow.parquet
import pytest
from cli_support import GOOD, SCENE, Outcome, process, provenance

from nlosctl.errors import DataError, hide_secrets
from nlosctl.io.paths.inputs import expand_inputs

Cli = Callable[..., Outcome]
SECRET = "f00Ba7s3cr3t"  # noqa: S105 - of a test


class Server(ThreadingHTTPServer):
    """Serves a Parquet and a CSV file on 127.0.0.1 to requests that have the secret, and records the requests."""

    requests: list[str]


class Handler(BaseHTTPRequestHandler):
    """Answers with a file, or 403 for a request without the secret."""

    server: Server

    def do_GET(self) -> None:
        """Answer, also to HEAD."""
        self.server.requests.append(self.path)
        name = self.path.partition("?")[0].rpartition("/")[2]
        signed = SECRET in self.path or "Authorization" in self.headers
        content = (self.folder / name).read_bytes() if signed and (self.folder / name).exists() else b"no"
        wanted = self.headers.get("Range", "").removeprefix("bytes=").partition("-")
        code = 403 if not signed else 200 if content != b"no" else 404
        if wanted[0] and code == 200:
            first, size, code = int(wanted[0]), len(content), 206
            content = content[first : int(wanted[2] or size) + 1]
        self.send_response(code)
        self.send_header("Accept-Ranges", "bytes")
        if code == 206:
            self.send_header("Content-Range", f"bytes {first}-{first + len(content) - 1}/{size}")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(content)

    do_HEAD = do_GET  # noqa: N815 - the name is that of http.server
    folder: Path

    def log_message(self, *_: object) -> None:
        """Print nothing."""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    """A running server with files."""
    pytest.importorskip("aiohttp")
    files = tmp_path / "files"
    files.mkdir()
    (files / "in.parquet").write_bytes(GOOD.read_bytes())
    (files / "bad.csv").write_text("snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n1,a,0,0,x,1\n")
    handler = type("FolderHandler", (Handler,), {"folder": files})
    running = Server(("127.0.0.1", 0), handler)
    running.requests = []
    thread = threading.Thread(target=running.serve_forever)
    thread.start()
    yield running
    running.shutdown()
    thread.join()
    running.server_close()


QUERIES = [
    f"?sig={SECRET}",
    f"?client_secret={SECRET}&part=7",
    f"?part=7&X-Amz-Signature={SECRET}&X-Amz-Credential=AKIA",
    f"?part=7&t={SECRET}0123456789abcdef01234567",
    f"?X-Goog-Signature={SECRET}",
    f"?access_token={SECRET}",
]


@pytest.mark.parametrize("query", QUERIES)
def test_a_query_is_sent_and_not_recorded(cli: Cli, server: Server, tmp_path: Path, query: str) -> None:
    """A signed URL is read; metadata, ``source``, report and messages have its other keys, and not the secret."""
    url = f"http://127.0.0.1:{server.server_port}/in.parquet{query}"
    words = ("localize", url, GOOD, "--scene", SCENE, "-v", "-o", "e.parquet", "--flags-out", "f.csv", "--hash")
    outcome = cli(*words, "--report", "r.json")
    assert outcome.code == 0, outcome.err
    assert any(SECRET in request for request in server.requests)
    assert all("in.parquet" in request for request in server.requests), "no file beside a signed one is asked for"
    written = b"".join(path.read_bytes() for path in tmp_path.iterdir() if path.is_file())
    assert SECRET.encode() not in written + outcome.err.encode()
    shown = provenance(tmp_path / "e.parquet")["inputs"][0]["name"]
    assert shown == hide_secrets(url)
    assert set(pyarrow.parquet.read_table(tmp_path / "e.parquet").column("source").to_pylist()) == {shown, str(GOOD)}
    assert ("part=7" in shown) == ("part=7" in query)
    assert cli("localize", url, "--scene", SCENE, "-o", "out/", "-q").code == 0
    assert SECRET not in (tmp_path / "out" / "_manifest.json").read_text()


@pytest.mark.parametrize("user", [SECRET, f"{SECRET}-x"])
def test_a_user_is_not_recorded(cli: Cli, server: Server, tmp_path: Path, user: str) -> None:
    """A token in place of a user's name is sent, and replaced by *** in results."""
    url = f"http://{user}@127.0.0.1:{server.server_port}/in.parquet"
    assert cli("localize", url, "--scene", SCENE, "-o", "e.parquet", "-q").code == 0
    assert provenance(tmp_path / "e.parquet")["inputs"][0]["name"] == url.replace(user, "***")


@pytest.mark.process
def test_faults_show_no_secret(cli: Cli, server: Server, tmp_path: Path) -> None:
    """Messages, bad rows, reports and tracebacks of faults name the file without its secret."""
    query = f"?sig={SECRET}"
    base = f"http://127.0.0.1:{server.server_port}"
    for name in ("bad.csv", "none.parquet", "in.parquet/x.parquet"):
        outcome = cli("localize", f"{base}/{name}{query}")
        assert outcome.code == 1
        assert "sig=***" in outcome.err
        assert SECRET not in outcome.err
    traced = process("localize", f"{base}/none.parquet{query}", "--debug", cwd=tmp_path)
    assert "Traceback" in traced.err
    assert SECRET not in traced.err
    forbidden = cli("localize", f"{base}/in.parquet?signature=wrong{SECRET[1:]}")
    assert (forbidden.code, SECRET[1:] in forbidden.err) == (1, False)
    assert SECRET not in cli("validate", f"{base}/bad.csv{query}", "--bad-rows", "b.csv").err
    assert "row" in (tmp_path / "b.csv").read_text()
    assert SECRET not in (tmp_path / "b.csv").read_text()
    refused = cli("localize", GOOD, "-o", f"nowhere://{SECRET}@host/e.parquet?token={SECRET}")
    assert (refused.code, SECRET in refused.err) == (2, False)
    with pytest.raises(DataError) as caught:
        expand_inputs([f"{base}/none.parquet{query}"])
    assert SECRET not in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://h/a.csv?X-Amz-Signature=ab&page=2", "https://h/a.csv?X-Amz-Signature=***&page=2"),
        ("s3://b/a.csv?region=us-east-1&endpoint_override=h:9", "s3://b/a.csv?region=us-east-1&endpoint_override=h:9"),
        ("abfs://container@account/a?sv=1&sig=x%2By", "abfs://container@account/a?sv=1&sig=***"),
        (
            "can't read 'http://t0k@h/a', url='http://h/?AWSAccessKeyId=Z'",
            "can't read 'http://***@h/a', url='http://h/?AWSAccessKeyId=***'",
        ),
        ("row 3: a@b.c = 5?", "row 3: a@b.c = 5?"),
    ],
)
def test_what_is_hidden(text: str, shown: str) -> None:
    """Users and values of secret keys are hidden, stores' settings and containers are not."""
    assert hide_secrets(text) == shown
    assert hide_secrets(shown) == shown
