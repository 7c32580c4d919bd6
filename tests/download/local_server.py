"""A server on this machine that answers as it is told, byte by byte, and keeps what it heard."""

import contextlib
import socket
import ssl
import threading
from collections.abc import Callable, Iterator

OK = b"HTTP/1.1 200 OK\r\n"


def plain(body: bytes, *headers: str) -> bytes:
    """A whole answer with its length."""
    lines = [f"Content-Length: {len(body)}", *headers]
    return OK + "".join(f"{line}\r\n" for line in lines).encode() + b"\r\n" + body


def moved(where: str, status: int = 302) -> bytes:
    return f"HTTP/1.1 {status} Moved\r\nLocation: {where}\r\nContent-Length: 0\r\n\r\n".encode()


class LocalServer:
    """Answers every connection once.

    An answer is bytes, or a function that is given the connection and does as it likes; it is
    chosen by the path without its query. ``heard`` holds every request, headers included.
    """

    def __init__(
        self, answers: dict, family: int = socket.AF_INET, tls: ssl.SSLContext | None = None
    ) -> None:
        self.answers = answers
        self._tls = tls
        self.heard: list[str] = []
        self._socket = socket.create_server(
            ("::1" if family == socket.AF_INET6 else "127.0.0.1", 0), family=family
        )
        self.port = self._socket.getsockname()[1]
        self.stopping = threading.Event()
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    @property
    def url(self) -> str:
        return f"{'https' if self._tls else 'http'}://127.0.0.1:{self.port}"

    @property
    def paths(self) -> list[str]:
        return [one.split(" ")[1] for one in self.heard]

    def close(self) -> None:
        self.stopping.set()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        for thread in self._threads:
            thread.join(10)

    def _accept(self) -> None:
        while not self.stopping.is_set():
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            thread = threading.Thread(target=self._serve, args=(connection,))
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        connection.settimeout(10)
        with contextlib.ExitStack() as open_ones:
            open_ones.enter_context(contextlib.suppress(OSError))
            if self._tls:
                open_ones.callback(connection.close)
                connection = self._tls.wrap_socket(connection, server_side=True)
            open_ones.enter_context(connection)
            request = b""
            while b"\r\n\r\n" not in request:
                part = connection.recv(65536)
                if not part:
                    return
                request += part
            text = request.decode("latin-1")
            self.heard.append(text)
            path = text.split(" ")[1].split("?")[0]
            answer = self.answers.get(path, b"HTTP/1.1 404 Gone\r\nContent-Length: 0\r\n\r\n")
            if isinstance(answer, list):
                answer = answer.pop(0) if len(answer) > 1 else answer[0]
            if isinstance(answer, bytes):
                connection.sendall(answer)
            else:
                answer(connection)


@contextlib.contextmanager
def serving(
    answers: dict[str, bytes | list | Callable],
    family: int = socket.AF_INET,
    tls: ssl.SSLContext | None = None,
) -> Iterator[LocalServer]:
    server = LocalServer(answers, family, tls)
    try:
        yield server
    finally:
        server.close()
