"""The CNC and its thermometer, on this side of the emulated computer, so that they go on when that one is cut off: a Modbus TCP
device. Register 0 is a temperature, register 10 an offset; who sets the one knows where the other has to go."""

import socketserver
import struct
import threading
import time

TEMPERATURE, OFFSET = 0, 10


def signed(word):
    return word - 0x10000 if word & 0x8000 else word


def exactly(stream, length):
    data = stream.read(length)
    if len(data) < length:
        raise ConnectionError
    return data


class Device:
    def __init__(self):
        self.registers = {TEMPERATURE: 0, OFFSET: 0}
        # Every write of the offset: when, from, to.
        self.writes = []
        device = self

        class Connection(socketserver.StreamRequestHandler):
            def handle(self):
                try:
                    while True:
                        transaction, protocol, length, unit = struct.unpack(">HHHB", exactly(self.rfile, 7))
                        answer = device.answer(exactly(self.rfile, length - 1))
                        self.wfile.write(struct.pack(">HHHB", transaction, protocol, len(answer) + 1, unit) + answer)
                except OSError:
                    pass

        class Server(socketserver.ThreadingTCPServer):
            allow_reuse_address = True
            daemon_threads = True

        self.server = Server(("127.0.0.1", 0), Connection)
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def answer(self, request):
        function, register, word = struct.unpack(">BHH", request[:5])
        if function == 3 and word == 1 and register in self.registers:
            return struct.pack(">BBH", 3, 2, self.registers[register] & 0xFFFF)
        if function in (6, 16) and register == OFFSET:
            to = signed(word if function == 6 else struct.unpack(">H", request[6:8])[0])
            self.writes.append((time.time(), self.registers[OFFSET], to))
            self.registers[OFFSET] = to
            return request[:5]
        return struct.pack(">BB", function | 0x80, 2)

    @property
    def offset(self):
        return self.registers[OFFSET]

    def is_as_warm_as(self, counts):
        self.registers[TEMPERATURE] = counts

    def moves(self):
        """The writes since the last look that changed it."""
        writes, self.writes = self.writes, []
        return [(at, before, after) for at, before, after in writes if before != after]
