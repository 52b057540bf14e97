"""The tiny run of the layers' tests; and no network, for nothing of language is downloaded."""

import socket

import pytest

from tests.layers.conftest import clip, scene  # noqa: F401


@pytest.fixture(autouse=True)
def no_network(monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("nothing of language may be downloaded")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
