"""A control that is a server of OPC UA (asyncua), with the nodes that docs/opcua.md names:  control.py CERTIFICATE KEY

It lets everybody in, secured or not, and stamps its values anew all the time. Prints `listens on PORT`."""

import asyncio
import sys

from asyncua import Server, ua

POLICIES = [
    ua.SecurityPolicyType.NoSecurity,
    ua.SecurityPolicyType.Basic256Sha256_Sign,
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]


async def main():
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0")
    await server.load_certificate(sys.argv[1])
    await server.load_private_key(sys.argv[2])
    server.set_security_policy(POLICIES)
    space = await server.register_namespace("urn:control")
    folder = await server.nodes.objects.add_folder(ua.NodeId("/Nck", space), "Nck")
    values = {"/Nck/LogicalSpindle/actSpeed": (folder, 1200.0)}
    values |= {f"/Plc/{name}": (server.nodes.objects, value) for name, value in (("DB100.DBD4", 23.5), ("DB100.DBD12", 0.0))}
    nodes = []
    for name, (place, value) in values.items():
        nodes.append((await place.add_variable(ua.NodeId(name, space), name, value, ua.VariantType.Double), value))
    await nodes[-1][0].set_writable()
    async with server:
        print("listens on", server.bserver._server.sockets[0].getsockname()[1], flush=True)
        while True:
            for node, value in nodes[:-1]:
                await node.write_value(value)
            await asyncio.sleep(0.1)


asyncio.run(main())
