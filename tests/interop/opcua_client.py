"""A client of OPC UA that is not ours (asyncua): does one thing with a server, and prints one line of JSON.

opcua_client.py URL [OPTIONS] browse             prints identifier and display name of each node below Objects/Machines
opcua_client.py URL [OPTIONS] read ID…           prints value, status and times of these nodes, and the unit of each
opcua_client.py URL [OPTIONS] write ID NUMBER    tries to write, and prints the status
opcua_client.py URL [OPTIONS] call AXIS ERROR [TIME [ID]]   calls the method `measured`, and prints its outputs
opcua_client.py URL [OPTIONS] methods            prints all methods below Objects/Machines
opcua_client.py URL [OPTIONS] watch SECONDS ID…  subscribes, prints `ready`, then how many changes each node had
opcua_client.py URL [OPTIONS] changes SECONDS ID…   subscribes, prints `ready`, then each change: node, status, value
opcua_client.py URL [OPTIONS] watch-all SECONDS  the same for the value of every signal
opcua_client.py URL [OPTIONS] many NUMBER SECONDS ID  the same with so many clients; prints the changes of each
opcua_client.py URL [OPTIONS] events SECONDS     subscribes to the events of the server, prints `ready`, then the events
opcua_client.py URL [OPTIONS] deaf SECONDS       subscribes to every signal, prints `ready`, and reads nothing any more
opcua_client.py URL [OPTIONS] endpoints          prints the endpoints, without a login
opcua_client.py URL [OPTIONS] sessions NUMBER    creates so many sessions without a login, on a channel without security

A refusal is {"error": NAME OF THE STATUS}. Node identifiers are those in the namespace of the gateway."""

import argparse
import asyncio
import json
import logging
import os
import socket
import sys

from asyncua import Client, ua
from asyncua.crypto import security_policies

NAMESPACE = "urn:isotherm:machine"
logging.disable(logging.CRITICAL)

parser = argparse.ArgumentParser()
parser.add_argument("url")
parser.add_argument("--user", help="NAME:PASSWORD")
parser.add_argument("--user-cert", help="file without its ending: the certificate .der and the key .pem")
parser.add_argument("--cert", help="file without its ending")
parser.add_argument("--server-cert")
parser.add_argument("--uri", default="urn:isotherm:test")
parser.add_argument("--policy", default="Aes256Sha256RsaPss")
parser.add_argument("--sign", action="store_true", help="signs without encryption")
parser.add_argument("does")
parser.add_argument("more", nargs="*")
given = parser.parse_intermixed_args()


async def client():
    made = Client(given.url, timeout=10)
    made.application_uri = given.uri
    if given.cert:
        mode = ua.MessageSecurityMode.Sign if given.sign else ua.MessageSecurityMode.SignAndEncrypt
        policy = getattr(security_policies, f"SecurityPolicy{given.policy}")
        files = (f"{given.cert}.der", f"{given.cert}.pem")
        await made.set_security(policy, *files, server_certificate=given.server_cert, mode=mode)
    if given.user:
        name, password = given.user.split(":", 1)
        made.set_user(name)
        made.set_password(password)
    if given.user_cert:
        await made.load_client_certificate(f"{given.user_cert}.der")
        await made.load_private_key(f"{given.user_cert}.pem")
    return made


class Changes:
    """Counts changes and keeps events."""

    def __init__(self):
        self.counts, self.events = {}, []

    def datachange_notification(self, node, value, data):
        name = node.nodeid.Identifier
        self.counts[name] = self.counts.get(name, 0) + 1

    def event_notification(self, event):
        self.events.append([event.Message.Text, event.Severity, event.SourceName])

    def status_change_notification(self, status):
        pass


class PrintedChanges(Changes):
    """Prints each change."""

    def datachange_notification(self, node, value, data):
        # On a busy computer, the lower bits say that the queue of the item was full.
        status = ua.StatusCode(data.monitored_item.Value.StatusCode.value & 0xFFFF0000)
        say([node.nodeid.Identifier, status.name, value])


def say(result):
    print(json.dumps(result), flush=True)


async def below(node, found, depth=0):
    for child in await node.get_children():
        name = (await child.read_display_name()).Text
        kind = await child.read_node_class()
        found.append((child.nodeid.Identifier, name, kind, child))
        if depth < 8 and kind != ua.NodeClass.Variable:
            await below(child, found, depth + 1)
    return found


async def signals(server, index):
    nodes = await server.get_node(ua.NodeId("Signals", index)).get_children()
    return [server.get_node(ua.NodeId(f"{node.nodeid.Identifier}.value", index)) for node in nodes]


async def watched(server, nodes, seconds, is_first=True, changes=None):
    changes = changes or Changes()
    subscription = await server.create_subscription(100, changes)
    for place in range(0, len(nodes), 200):
        await subscription.subscribe_data_change(nodes[place : place + 200], sampling_interval=100)
    if is_first:
        print("ready", flush=True)
    await asyncio.sleep(seconds)
    return changes.counts


async def one(server, index):
    does, more = given.does, given.more
    node = lambda name: server.get_node(ua.NodeId(name, index))
    if does in ("browse", "methods"):
        machines = await server.nodes.objects.get_child([f"{index}:Machines"])
        found = await below(machines, [])
        if does == "methods":
            return [name for name, _, kind, _ in found if kind == ua.NodeClass.Method]
        return {name: shown for name, shown, _, _ in found}
    if does == "read":
        read = {}
        for name in more:
            value = await node(name).read_data_value(raise_on_bad_status=False)
            unit = None
            if name.endswith(("_um", ".value")):
                unit = (await node(f"{name}.EngineeringUnits").read_value()).DisplayName.Text
            times = [str(value.SourceTimestamp), str(value.ServerTimestamp)]
            read[name] = {"value": value.Value.Value, "status": value.StatusCode.name, "times": times, "unit": unit}
        return read
    if does == "write":
        await node(more[0]).write_value(ua.Variant(float(more[1]), ua.VariantType.Double))
        return "written"
    if does == "call":
        axis, error, *rest = more
        rest = [ua.Variant(text, ua.VariantType.String) for text in (rest + ["", ""])[:2]]
        error = ua.Variant(float(error), ua.VariantType.Double)
        return await node(f"axis.{axis}").call_method(ua.NodeId(f"axis.{axis}.measured", index), error, *rest)
    if does == "watch":
        return await watched(server, [node(name) for name in more[1:]], float(more[0]))
    if does == "changes":
        return await watched(server, [node(name) for name in more[1:]], float(more[0]), changes=PrintedChanges())
    if does == "watch-all":
        return await watched(server, await signals(server, index), float(more[0]))
    if does == "events":
        changes = Changes()
        subscription = await server.create_subscription(100, changes)
        await subscription.subscribe_events(queuesize=10)
        print("ready", flush=True)
        await asyncio.sleep(float(more[0]))
        return changes.events
    if does == "deaf":
        subscription = await server.create_subscription(100, Changes())
        nodes = await signals(server, index)
        for place in range(0, len(nodes), 200):
            await subscription.subscribe_data_change(nodes[place : place + 200], sampling_interval=100)
        await asyncio.sleep(1)
        transport = server.uaclient.protocol.transport
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        transport.pause_reading()
        print("ready", flush=True)
        # It goes on to ask, and reads no answer.
        asked = []
        for _ in range(int(float(more[0]) * 20)):
            asked.append(asyncio.ensure_future(server.read_values(nodes)))
            await asyncio.sleep(0.05)
        # A connection that the server has closed cannot be closed in order.
        say("deaf")
        os._exit(0)
    sys.exit(f"{does}?")


async def many(number, seconds, name):
    async def of_one(place):
        async with await client() as server:
            index = await server.get_namespace_index(NAMESPACE)
            counts = await watched(server, [server.get_node(ua.NodeId(name, index))], seconds, place == number - 1)
            return counts.get(name, 0)

    return await asyncio.gather(*(of_one(place) for place in range(number)))


async def main():
    if given.does == "endpoints":
        found = await Client(given.url, timeout=10).connect_and_get_server_endpoints()
        return [[one.SecurityMode.name, one.SecurityPolicyUri.split("#")[1], one.EndpointUrl] for one in found]
    if given.does == "sessions":
        made = Client(given.url, timeout=10)
        await made.connect_sessionless()
        asks = ua.CreateSessionParameters(EndpointUrl=given.url, SessionName="many", RequestedSessionTimeout=60000)
        for _ in range(int(given.more[0])):
            await made.uaclient.create_session(asks)
        return "created"
    if given.does == "many":
        return await many(int(given.more[0]), float(given.more[1]), given.more[2])
    async with await client() as server:
        return await one(server, await server.get_namespace_index(NAMESPACE))


try:
    say(asyncio.run(main()))
except (ua.UaStatusCodeError, ConnectionError, asyncio.TimeoutError, ua.UaError) as error:
    name = ua.StatusCode(error.code).name if isinstance(error, ua.UaStatusCodeError) else type(error).__name__
    say({"error": name, "text": str(error)})
