"""A server of OPC UA that is not ours (asyncua), and does what its standard input says, a line each:

value NAME NUMBER    the node holds this
status NAME STATUS   the node is given with this status
stamp NAME SECONDS   the node is stamped so much later than now; earlier where negative
refuse NAME STATUS   a write of the node is answered with this status
keep NAME            a write of the node is answered with Good, and not done
hold NAME SECONDS    a write of the node is done, and answered so much later
round NAME DIGITS    the node keeps so many digits behind the point
allow NAME           a write of the node is done as before
acknowledge SECONDS  the node `taken` follows the node `strobe` so much later
die NAME             once the node was written, the server ends where it is read
values NAME          prints what was written into the node, one after the other
log                  prints each call that wrote or read nodes that are written, one after the other, and forgets them
sessions NUMBER      so many sessions may be made from now on
drop                 every session is over
open                 prints how many sessions there are
silent on|off        subscriptions send nothing
forget               every subscription is ended, and nobody is told
subscriptions        prints how many there are
reads                prints how often nodes of these were read by a call
read NAME            prints what the node holds
other NAME           prints what the node of this name holds in the first namespace of another machine
load                 the namespace of the machine is in the server's list from now on
logins               prints how often a login was tried
refusals             prints how many calls were refused because of their size, and forgets them
taken                prints how many logins there are, and how many lists of nodes are kept for whoever asks on

Each is acknowledged with a line. Every tenth of a second each value is stamped anew, as a control does that measures."""

import argparse
import asyncio
import gc
import os
import sys
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path

# Half of the time of a start goes into searches for garbage while the address space grows, and each test starts a server.
gc.disable()

from asyncua import Server, ua
from asyncua.server.internal_session import InternalSession, SessionState
from asyncua.server.internal_subscription import InternalSubscription
from asyncua.server.uaprocessor import UaProcessor
from asyncua.server.user_managers import UserManager
from asyncua.common.connection import TransportLimits
from asyncua.crypto import security_policies
from asyncua.ua.ua_binary import struct_from_binary
from asyncua.crypto.permission_rules import User, UserRole
from cryptography import x509

parser = argparse.ArgumentParser()
parser.add_argument("--port", type=int, default=0)
parser.add_argument("--cert")
parser.add_argument("--key")
parser.add_argument("--user")
parser.add_argument("--user-cert")
parser.add_argument("--few", type=int, default=0)
parser.add_argument("--most-written", type=int, default=0)
parser.add_argument("--holds", action="append", default=[])
parser.add_argument("--most", type=int, default=0, help="so many nodes in a call, read or subscribed to")
parser.add_argument("--unsaid", type=int, default=0, help="so many nodes in a call, read or subscribed to, and the server does not say so")
parser.add_argument("--refusal", default="BadTooManyOperations", help="how a call that is too large is refused")
parser.add_argument("--huge", help="a call that reads this node is refused because of its size")
parser.add_argument("--buffers", help="bytes of a chunk, chunks of a message, bytes of a message: 8192,1,0")
parser.add_argument("--chain", help="the certificate of an authority, which is sent after the server's own")
parser.add_argument("--subscriptions", type=int, default=1000, help="so many at once")
parser.add_argument("--journal", help="a file to which is added what is told, written and read back, each with its moment")
parser.add_argument("--many", type=int, default=0, help="so many nodes more: many0, many1, …")
parser.add_argument("--changing", action="store_true", help="each of the many changes every tenth of a second")
parser.add_argument("--interval", type=float, default=0, help="subscriptions send no sooner than this, milliseconds")
parser.add_argument("--before", type=int, default=0, help="so many namespaces of other machines come first, with nodes of the same names")
parser.add_argument("--twice", action="store_true", help="the namespace of the machine is there twice")
parser.add_argument("--uri", default="urn:test", help="the URI of the machine's namespace")
parser.add_argument("--late", action="store_true", help="the namespace of the machine is in the server's list only after `load`")
arguments = parser.parse_args()

journal = open(arguments.journal, "a", buffering=1) if arguments.journal else None


def note(*words):
    if journal:
        print(time.monotonic(), *words, file=journal)


NODES = {
    "bed": (20.0, ua.VariantType.Float),
    "scale": (100_000, ua.VariantType.Int32),
    "offset": (0, ua.VariantType.Int32),
    "k0": (0.0, ua.VariantType.Double),
    "text": ("text", ua.VariantType.String),
    "tan": (0.0, ua.VariantType.Double),
    "p0": (0.0, ua.VariantType.Double),
    "beat": (0, ua.VariantType.Int16),
    "control": (0, ua.VariantType.UInt16),
    "version": (0, ua.VariantType.Byte),
    "strobe": (False, ua.VariantType.Boolean),
    "taken": (False, ua.VariantType.Boolean),
    "boots": (1, ua.VariantType.UInt32),
    "life": (0, ua.VariantType.Int16),
}
READ_ONLY = ("bed", "taken", "boots")
FLOATS = (ua.VariantType.Float, ua.VariantType.Double)


def variant(name, number):
    kind = NODES[name][1]
    if kind == ua.VariantType.String:
        return ua.Variant(number, kind)
    return ua.Variant(float(number) if kind in FLOATS else int(number), kind)


# A session outlives its connection, as the standard has it; asyncua alone lets only those with subscriptions.
UaProcessor._should_close_session_on_transport_loss = lambda self: False
process = UaProcessor._process_message
BEGINS = {
    ua.ObjectIds.GetEndpointsRequest_Encoding_DefaultBinary,
    ua.ObjectIds.CreateSessionRequest_Encoding_DefaultBinary,
    ua.ObjectIds.ActivateSessionRequest_Encoding_DefaultBinary,
}


async def processed(self, kind, *rest):
    # One that is over is served no more, as the standard has it; asyncua alone goes on.
    if self.session and self.session.state is SessionState.Closed and kind.Identifier not in BEGINS:
        raise ua.uaerrors.BadSessionIdInvalid()
    return await process(self, kind, *rest)


UaProcessor._process_message = processed

logins = [0]
activate = InternalSession.activate_session


def activated(self, params, *rest):
    logins[0] += self.external
    return activate(self, params, *rest)


InternalSession.activate_session = activated

authority = Path(arguments.chain).read_bytes() if arguments.chain else b""
if authority:
    policy_of = security_policies.SecurityPolicyFactory.create

    def with_chain(self, peer):
        self.certificate_chain = [x509.load_der_x509_certificate(authority)]
        return policy_of(self, peer)

    security_policies.SecurityPolicyFactory.create = with_chain


class OneUser(UserManager):
    def get_user(self, iserver, username=None, password=None, certificate=None):
        if arguments.user_cert:
            known = Path(arguments.user_cert).read_bytes()
            return User(role=UserRole.User) if certificate == known else None
        if arguments.user is None or f"{username}:{password}" == arguments.user:
            return User(role=UserRole.User)
        return None


async def main():
    server = Server(user_manager=OneUser())
    if arguments.buffers:
        chunk, chunks, message = (int(number) for number in arguments.buffers.split(","))
        server.limits = TransportLimits(chunk, chunk, chunks, message)
    await server.init()
    gc.freeze()
    gc.enable()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{arguments.port}")
    policies = [ua.SecurityPolicyType.NoSecurity]
    if arguments.cert:
        policies += [
            ua.SecurityPolicyType.Basic256Sha256_Sign,
            ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
            ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
        ]
        await server.load_certificate(arguments.cert)
        await server.load_private_key(arguments.key)
    server.set_security_policy(policies)
    tokens = [ua.UserNameIdentityToken] if arguments.user else [ua.AnonymousIdentityToken]
    if arguments.user_cert:
        tokens = [ua.X509IdentityToken]
    server.set_identity_tokens(tokens)
    others = []
    for place in range(arguments.before):
        other = await server.register_namespace(f"urn:other{place}")
        others.append({})
        for name, (value, kind) in NODES.items():
            value = 90.0 if name == "bed" else value
            node = await server.nodes.objects.add_variable(ua.NodeId(name, other), name, value, kind)
            await node.set_writable()
            others[place][name] = node
    space = await server.register_namespace(arguments.uri)
    array = server.get_node(ua.ObjectIds.Server_NamespaceArray)
    uris = await array.read_value()
    if arguments.late:
        await array.write_value(uris[:-1])
    if arguments.twice:
        await array.write_value([*uris, arguments.uri])
    nodes, held, status, late = {}, {}, {}, {}
    for name, (value, kind) in NODES.items():
        node = await server.nodes.objects.add_variable(ua.NodeId(name, space), name, value, kind)
        if name not in READ_ONLY:
            await node.set_writable()
        nodes[name], held[name] = node, ua.Variant(value, kind)
    folder = await server.nodes.objects.add_folder(ua.NodeId("folder", space), "folder")
    for name in "abcde":
        inner = await folder.add_variable(ua.NodeId(name, space), name, 1.0)
        if name == "a":
            await inner.add_variable(ua.NodeId("below", space), "below", 2.0)
    await server.nodes.objects.add_variable(ua.NodeId("several", space), "several", [1.0, 2.0])
    hidden = await server.nodes.objects.add_variable(ua.NodeId("hidden", space), "hidden", 1.0)
    await hidden.unset_attr_bit(ua.AttributeIds.UserAccessLevel, ua.AccessLevel.CurrentRead)
    many = [
        await server.nodes.objects.add_variable(ua.NodeId(f"many{place}", space), f"many{place}", 20.0, ua.VariantType.Float)
        for place in range(arguments.many)
    ]
    held |= {name: variant(name, number) for name, number in (one.split("=") for one in arguments.holds)}
    if arguments.most:
        limit = server.get_node(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerRead)
        await limit.write_value(ua.Variant(arguments.most, ua.VariantType.UInt32))
        limit = server.get_node(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall)
        await limit.write_value(ua.Variant(arguments.most, ua.VariantType.UInt32))
    if arguments.most_written:
        limit = server.get_node(ua.ObjectIds.Server_ServerCapabilities_OperationLimits_MaxNodesPerWrite)
        await limit.write_value(ua.Variant(arguments.most_written, ua.VariantType.UInt32))
    refused, kept, held_back, digits = {}, set(), {}, {}
    values, log, ends, reacts = {name: [] for name in NODES}, [], {}, [None]
    names = {node.nodeid: name for name, node in nodes.items()}

    service = server.iserver.attribute_service
    write, read = service.write, service.read

    async def acknowledge(up, after):
        await asyncio.sleep(after)
        held["taken"] = ua.Variant(up, ua.VariantType.Boolean)
        await stamp()

    def told(what, asked):
        found = [name for name in (names.get(one.NodeId) for one in asked) if name]
        if found and not any(name in READ_ONLY for name in found):
            log.append(f"{what} {' '.join(found)}")

    async def written(params, user=User(role=UserRole.Admin)):
        results = []
        if arguments.most_written and len(params.NodesToWrite) > arguments.most_written:
            raise ua.uaerrors.BadTooManyOperations()
        told("write", params.NodesToWrite)
        for one in params.NodesToWrite:
            name = names.get(one.NodeId)
            if name in digits:
                found = one.Value.Value
                one.Value.Value = ua.Variant(round(found.Value, digits[name]), found.VariantType)
            alone = ua.WriteParameters(NodesToWrite=[one])
            if name and (one.Value.SourceTimestamp or one.Value.ServerTimestamp):
                results.append(ua.StatusCode(ua.StatusCodes.BadWriteNotSupported))
            elif name in refused:
                results.append(ua.StatusCode(refused[name]))
            elif name in kept:
                results.append(ua.StatusCode(ua.StatusCodes.Good))
            else:
                done = (await write(alone, user))[0]
                if done.is_good() and name:
                    note("write", name, held[name].Value, one.Value.Value.Value)
                    held[name] = one.Value.Value
                    values[name].append(one.Value.Value.Value)
                    if name in ends:
                        ends[name] = True
                    if name == "strobe" and reacts[0] is not None:
                        asyncio.create_task(acknowledge(one.Value.Value.Value, reacts[0]))
                results.append(done)
            if name in held_back:
                await asyncio.sleep(held_back.pop(name))
        return results

    reads, too_large = [0], [0]

    def refuse_large(count, is_huge=False):
        if is_huge or (arguments.unsaid and count > arguments.unsaid):
            too_large[0] += 1
            raise getattr(ua.uaerrors, arguments.refusal)()

    def asked(params):
        reads[0] += any(one.NodeId in names for one in params.NodesToRead)
        is_huge = any(arguments.huge and names.get(one.NodeId) == arguments.huge for one in params.NodesToRead)
        refuse_large(len(params.NodesToRead), is_huge)
        if arguments.most and len(params.NodesToRead) > arguments.most:
            raise ua.uaerrors.BadTooManyOperations()
        told("read", params.NodesToRead)
        for name in {names.get(one.NodeId) for one in params.NodesToRead} - {None, *READ_ONLY}:
            note("read", name)
        if any(ends.get(names.get(one.NodeId)) for one in params.NodesToRead):
            os._exit(1)
        return read(params)

    service.write, service.read = written, asked
    rest = {}
    browse = server.iserver.view_service.browse

    def part(references, most):
        """As many references as are taken at once, and where the rest is kept."""
        most = min(filter(None, (most, arguments.few)), default=len(references))
        point = None
        if len(references) > most:
            point = str(len(rest)).encode()
            rest[point] = references[most:]
        return ua.BrowseResult(ContinuationPoint=point, References=references[:most])

    def browsed(params):
        results = browse(params)
        for result in results:
            found = part(result.References, params.RequestedMaxReferencesPerNode)
            result.References, result.ContinuationPoint = found.References, found.ContinuationPoint
        return results

    process = UaProcessor._process_message

    async def processed(self, kind, header, sequence, body):
        """BrowseNext, which asyncua does not know."""
        if kind != ua.NodeId(ua.ObjectIds.BrowseNextRequest_Encoding_DefaultBinary):
            return await process(self, kind, header, sequence, body)
        params = struct_from_binary(ua.BrowseNextParameters, body)
        kept = [rest.pop(point, []) for point in params.ContinuationPoints]
        answer = ua.BrowseNextResponse()
        if not params.ReleaseContinuationPoints:
            answer.Parameters.Results = [part(references, 0) for references in kept]
        self.send_response(header.RequestHandle, sequence, answer)
        return True

    server.iserver.view_service.browse = browsed
    UaProcessor._process_message = processed
    server.iserver.max_subscriptions = arguments.subscriptions
    subscribing = server.iserver.subscription_service
    subscribe, monitor = subscribing.create_subscription, subscribing.create_monitored_items

    async def subscribed(params, *rest, **more):
        params.RequestedPublishingInterval = max(params.RequestedPublishingInterval, arguments.interval)
        return await subscribe(params, *rest, **more)

    async def monitored(params):
        if arguments.most and len(params.ItemsToCreate) > arguments.most:
            raise ua.uaerrors.BadTooManyOperations()
        if arguments.unsaid and len(params.ItemsToCreate) > arguments.unsaid and "Response" in arguments.refusal:
            # The call is executed, and only its answer is too long.
            await monitor(params)
        refuse_large(len(params.ItemsToCreate))
        return await monitor(params)

    subscribing.create_subscription, subscribing.create_monitored_items = subscribed, monitored
    silent = [False]
    publish = InternalSubscription.publish_results

    async def published(self, *rest):
        return False if silent[0] else await publish(self, *rest)

    InternalSubscription.publish_results = published
    left = [None]
    create = server.iserver.create_session

    def created(name, *rest, **more):
        if more.get("external") and left[0] is not None:
            if left[0] <= 0:
                raise ua.uaerrors.BadTooManySessions()
            left[0] -= 1
        return create(name, *rest, **more)

    server.iserver.create_session = created

    async def stamp():
        now = datetime.now(timezone.utc)
        for name, node in nodes.items():
            value = ua.DataValue(
                held[name],
                ua.StatusCode(status.get(name, ua.StatusCodes.Good)),
                now + timedelta(seconds=late.get(name, 0)),
            )
            await server.write_attribute_value(node.nodeid, value)

    async def stamps():
        while True:
            await stamp()
            if arguments.changing:
                await change()
            await asyncio.sleep(0.1)

    async def change():
        now = datetime.now(timezone.utc)
        for place, node in enumerate(many):
            number = 20.0 + (time.monotonic() * 10 + place) % 10
            value = ua.DataValue(ua.Variant(number, ua.VariantType.Float), ua.StatusCode(ua.StatusCodes.Good), now)
            await server.write_attribute_value(node.nodeid, value)

    async with server:
        for endpoint in server.iserver.endpoints:
            if endpoint.ServerCertificate:
                endpoint.ServerCertificate += authority
        port = server.bserver._server.sockets[0].getsockname()[1]
        note("start")
        print(port, flush=True)
        stamping = asyncio.create_task(stamps())
        lines = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
        while line := (await lines.readline()).decode().split():
            answer = "done"
            note(*line)
            match line:
                case ["value", name, number]:
                    held[name] = variant(name, number)
                case ["status", name, code]:
                    status[name] = getattr(ua.StatusCodes, code)
                case ["stamp", name, seconds]:
                    late[name] = float(seconds)
                case ["refuse", name, code]:
                    refused[name] = getattr(ua.StatusCodes, code)
                case ["keep", name]:
                    kept.add(name)
                case ["hold", name, seconds]:
                    held_back[name] = float(seconds)
                case ["round", name, number]:
                    digits[name] = int(number)
                case ["allow", name]:
                    refused.pop(name, None)
                    kept.discard(name)
                case ["acknowledge", seconds]:
                    reacts[0] = float(seconds)
                case ["die", name]:
                    ends[name] = False
                case ["values", name]:
                    answer = " ".join(str(value) for value in values[name])
                case ["log"]:
                    answer = ";".join(log)
                    log.clear()
                case ["sessions", number]:
                    left[0] = int(number)
                case ["taken"]:
                    answer = f"{InternalSession._current_connections} {len(rest)}"
                case ["logins"]:
                    answer = str(logins[0])
                case ["refusals"]:
                    answer, too_large[0] = str(too_large[0]), 0
                case ["drop"]:
                    for session in list(server.iserver._external_sessions.values()):
                        await session.close_session(True)
                case ["silent", how]:
                    silent[0] = how == "on"
                case ["forget"]:
                    await subscribing.delete_subscriptions(list(subscribing.subscriptions))
                case ["subscriptions"]:
                    answer = str(len(subscribing.subscriptions))
                case ["reads"]:
                    answer = str(reads[0])
                case ["open"]:
                    answer = str(len(server.iserver._external_sessions))
                case ["other", name]:
                    answer = str(await others[0][name].read_value())
                case ["load"]:
                    await array.write_value(uris)
                case ["read", name]:
                    answer = str(held[name].Value)
                case _:
                    answer = f"unknown: {line}"
            await stamp()
            print(answer, flush=True)
        stamping.cancel()


asyncio.run(main())
