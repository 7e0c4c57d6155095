"""Errors of stores are one line with a cure; the region may come from the environment."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from nlosctl.errors import UsageError
from nlosctl.io.paths.stores import answering


@pytest.mark.parametrize(
    ("raised", "message"),
    [
        (ValueError("AWS Error ACCESS_DENIED during HeadObject\nrequest 4711"), "check the credentials"),
        (RuntimeError("Anonymous caller does not have storage.objects.get"), "check the credentials"),
        (OSError("Unable to load libjvm\nlibjvm.so"), "hdfs:// needs Java and Hadoop's client"),
        (OSError("When resolving region for bucket 'a': AWS Error NETWORK_CONNECTION"), "check the name"),
        (KeyError(), "KeyError"),
        (ConnectionError("the   store is\tgone"), "the store is gone"),
    ],
)
def test_whatever_a_store_raises_is_one_line(raised: Exception, message: str) -> None:
    """An OSError that names the file, with the first line of the error and a cure if one is known."""
    with pytest.raises(OSError, match=r"s3://bucket/a\.csv") as caught, answering("s3://bucket/a.csv"):
        raise raised
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_says_enough_already_passes() -> None:
    """A missing file keeps the message of the system; errors of nlosctl are unchanged."""
    with pytest.raises(FileNotFoundError, match="No such file or directory: 'gs://b/a'"), answering("gs://b/a"):
        raise FileNotFoundError("b/a")
    for error in (UsageError("as it was"), FileExistsError("as it was"), OSError(5, "as it was", "gs://b/a")):
        with pytest.raises(type(error), match="as it was") as caught, answering("gs://b/a"):
            raise error
        assert caught.value is error


@pytest.mark.process
@pytest.mark.parametrize(("query", "region"), [("", "eu-central-1"), ("?region=us-west-2", "us-west-2")])
def test_the_region_is_of_the_url_or_the_environment(query: str, region: str) -> None:
    """AWS_REGION avoids a request for the region; the URL takes precedence. No network is used."""
    code = (
        "from nlosctl.io.paths.stores import filesystem_of\n"
        f"store, bucket = filesystem_of(1, 's3', 'bucket', '{query}'); print(store.region, bucket)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "AWS_REGION": "eu-central-1", "AWS_EC2_METADATA_DISABLED": "true"},
    )
    assert done.stdout.split() == [region, "bucket"]
