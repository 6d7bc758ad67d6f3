"""The application for phones in the same network: which addresses it answers, and what is asked before."""

import socket

import pytest
from helpers.guarded import status
from typer.testing import CliRunner

from relight.app import serving
from relight.cli.commands import app as command_line

ALL, LAN = "0.0.0.0", "192.168.1.5"


@pytest.mark.parametrize(
    ("listening", "came_to", "host", "expected"),
    [
        ("127.0.0.1", "127.0.0.1", "127.0.0.1:8000", 200),
        ("127.0.0.1", LAN, f"{LAN}:8000", 403),  # such as behind a forwarded port
        (ALL, LAN, f"{LAN}:8000", 200),
        (ALL, "127.0.0.1", "localhost:8000", 200),
        (ALL, LAN, "192.168.1.6:8000", 403),
        (ALL, LAN, f"{LAN}:8001", 403),
        (ALL, LAN, "rebound.example:8000", 403),
        (ALL, None, f"{LAN}:8000", 403),
        (LAN, LAN, f"{LAN}:8000", 200),
        (LAN, LAN, "127.0.0.1:8000", 403),
        (LAN, "10.0.0.9", "10.0.0.9:8000", 403),
    ],
)
def test_only_the_chosen_addresses_are_answered(listening, came_to, host, expected):
    assert status(listening=listening, came_to=came_to, host=host) == expected


def test_other_sites_and_a_wrong_token_are_refused_in_a_network_too():
    given = {"listening": ALL, "came_to": LAN, "host": f"{LAN}:8000"}
    assert status(origin=f"http://{LAN}:8000", **given) == 200
    assert status(origin="http://rebound.example", **given) == 403
    assert status("/other-token/", **given) == 403


@pytest.mark.parametrize("host", ["", "::", "example.com", "192.168.1", "0.0.0.0/0"])
def test_a_host_that_is_no_address_is_refused(host):
    with pytest.raises(ValueError, match="host: expected an IPv4 address of this machine"):
        serving.address_of(host)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(OSError, match=r"host 192\.0\.2\.7: is no address of this machine"):
        serving.serve(None, 0, lambda address: None, "192.0.2.7")


def run(monkeypatch, *words, **options):
    """The command with a server that only says its address; the hosts that were served, and what was said."""
    served = []

    def serve(root, port, opened, host):
        served.append(host)
        opened(f"http://{LAN}:8000/token/")

    monkeypatch.setattr(serving, "serve", serve)
    result = CliRunner().invoke(command_line, ["app", "--no-browser", *words], **options)
    return served, result


def test_it_is_off_and_asked_for(monkeypatch):
    served, result = run(monkeypatch)
    assert served == ["127.0.0.1"]
    assert "not encrypted" not in result.output
    served, result = run(monkeypatch, "--host", ALL, input="n\n")
    assert served == []
    assert result.exit_code == 1
    assert "not encrypted" in " ".join(result.output.split())
    served, result = run(monkeypatch, "--host", ALL)  # nobody answers
    assert served == []
    served, result = run(monkeypatch, "--host", ALL, input="y\n")
    assert served == [ALL]


def test_a_phone_reads_the_address_from_a_code(monkeypatch):
    pytest.importorskip("segno")
    served, result = run(monkeypatch, "--host", ALL, "--yes")
    assert served == [ALL]
    assert f"http://{LAN}:8000/token/" in result.output.splitlines()
    code = [line for line in result.output.splitlines() if set(line) & set("█▀▄")]
    assert len(code) > 10
    assert len({len(line) for line in code}) <= 2


def test_the_address_is_one_that_other_machines_reach():
    assert serving.reachable(LAN) == LAN
    socket.inet_aton(serving.reachable(ALL))
    assert serving.reachable(ALL) != ALL
