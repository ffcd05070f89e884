"""The registers on Modbus TCP. pymodbus does the connections and the frames; what is answered is decided here.

The classes that pymodbus has for registers are no use for this: they write before anybody can say no, and their names and
arguments change with every other version. So each function is a class of ours that keeps the bytes of the request.
It runs with pymodbus 3.0 (Debian 12) and later ones.
"""

import inspect
import logging
import struct

from pymodbus import pdu

try:
    from pymodbus.server.async_io import ModbusTcpServer
except ImportError:
    from pymodbus.server import ModbusTcpServer

from .gate import Refused

READ_BITS, READ_HOLDING, READ_INPUT, WRITE_BLOCK = 2, 3, 4, 16
OTHER_WRITES = (6, 22, 23)
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

try:
    # Up to 3.7. Whether a request is carried out in a coroutine (since 3.6), only those that do something tell.
    from pymodbus.register_read_message import ReadHoldingRegistersRequest

    IS_COROUTINE = inspect.iscoroutinefunction(ReadHoldingRegistersRequest.execute)
except ImportError:
    IS_COROUTINE = True

Request = getattr(pdu, "ModbusRequest", None) or pdu.ModbusPDU
Response = getattr(pdu, "ModbusResponse", None) or pdu.ModbusPDU


class Reply(Response):
    """The bytes after the function code."""

    rtu_frame_size = 5

    def __init__(self, function, data):
        super().__init__()
        self.function_code, self.data = function, data

    def encode(self):
        return self.data

    def decode(self, data):
        self.data = data


class Server:
    """Answers out of a gate. `refresh` makes it look at the machine, `apply` hands on what was accepted."""

    def __init__(self, gate, refresh, apply):
        self.gate, self.refresh, self.apply = gate, refresh, apply

    def create(self, address, port):
        """The server of pymodbus, to be run with serve_forever; an event loop must be running."""
        # It calls every connection that ends an error.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        options = {}
        if "allow_reuse_address" in inspect.signature(ModbusTcpServer.__init__).parameters:
            # Else it could not listen again for a minute after a restart.
            options["allow_reuse_address"] = True
        server = ModbusTcpServer(no_registers(), address=(address, port), **options)
        if hasattr(server, "allow_reuse_address"):
            server.framer = whole_frames(server.framer)
        for function in range(1, 128):
            server.decoder.register(self.request(function))
        return server

    def request(self, function):
        """A class of pymodbus for one function."""
        outer = self

        class OneRequest(Request):
            """Keeps its bytes, and answers itself."""

            function_code = function
            rtu_frame_size = 8

            def __init__(self, *arguments, **named):
                super().__init__(*arguments, **named)
                self.data = b""

            def decode(self, data):
                self.data = data

            def encode(self):
                return self.data

            async def in_a_coroutine(self, *_):
                return outer.reply(function, self.data)

            def at_once(self, *_):
                return outer.reply(function, self.data)

            # As pymodbus calls it up to 3.7, from 3.8 and in the latest.
            execute = in_a_coroutine if IS_COROUTINE else at_once
            update_datastore = datastore_update = in_a_coroutine

        return OneRequest

    def reply(self, function, data):
        now = self.refresh()
        try:
            answer = self.answer(function, data, now)
        except (Refused, struct.error):
            answer = ILLEGAL_VALUE
        self.apply()
        if isinstance(answer, int):
            return pdu.ExceptionResponse(function, answer)
        return Reply(function, answer)

    def answer(self, function, data, now):
        if function in (READ_HOLDING, READ_INPUT, READ_BITS):
            tables = {READ_HOLDING: self.gate.words, READ_INPUT: self.gate.inputs(), READ_BITS: self.gate.status()}
            words = tables[function]
            start, count = struct.unpack(">HH", data)
            if count == 0:
                return ILLEGAL_VALUE
            if start + count > len(words):
                return ILLEGAL_ADDRESS
            words = words[start : start + count]
            if function == READ_BITS:
                return struct.pack(">BB", 1, sum(bit << place for place, bit in enumerate(words)))
            return struct.pack(f">B{count}H", 2 * count, *words)
        if function == WRITE_BLOCK:
            start, count, size = struct.unpack_from(">HHB", data)
            if size != 2 * count or len(data) != 5 + size:
                return ILLEGAL_VALUE
            self.gate.write(start, list(struct.unpack(f">{count}H", data[5:])), now)
            return data[:4]
        if function in OTHER_WRITES:
            self.gate.write(struct.unpack_from(">H", data)[0], [], now)
        return ILLEGAL_FUNCTION


def no_registers():
    """pymodbus wants registers; ours are not asked out of them."""
    try:
        from pymodbus.datastore import ModbusServerContext  # pylint: disable=import-outside-toplevel

        return ModbusServerContext()
    except (ImportError, TypeError):
        from pymodbus.simulator import SimData, SimDevice  # pylint: disable=import-outside-toplevel

        return SimDevice(0, simdata=[SimData(0, values=0)])


def listens(server):
    """The first is where pymodbus 3.0 has its socket, the second where later ones do."""
    return bool(getattr(server, "server", None) or getattr(server, "transport", None))


def whole_frames(framer):
    """pymodbus before 3.7 drops a request that arrives in two pieces."""

    class WholeFrames(framer):
        """Waits for the rest."""

        def processIncomingPacket(self, data, callback, *_, **__):  # pylint: disable=invalid-name
            self._buffer += data
            while len(self._buffer) >= 8:
                transaction, protocol, length, unit = struct.unpack(">HHHB", self._buffer[:7])
                if protocol != 0 or not 2 <= length <= 254:
                    raise ValueError("this is not Modbus TCP")
                if len(self._buffer) < 6 + length:
                    return
                body, self._buffer = self._buffer[7 : 6 + length], self._buffer[6 + length :]
                if not 1 <= body[0] < 128:
                    raise ValueError("this is not a request")
                request = self.decoder.decode(body)
                self._header = {"tid": transaction, "pid": protocol, "len": length, "uid": unit}
                self.populateResult(request)
                callback(request)

    return WholeFrames
