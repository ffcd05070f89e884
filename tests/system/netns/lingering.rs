//! Counterexample: connections whose last bytes the kernel still delivers after they were closed.

use std::sync::Arc;

use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::{Fault, LinkFault};
use isotherm::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::Boxed;
use isotherm::gateway::Dialer;
use tokio::net::TcpStream;

/// Opens connections in the usual way, without measures against late delivery by the kernel.
pub(crate) fn dialer() -> Dialer {
    Arc::new(|bus| Some(Box::new(Lingering(bus.address.clone()))))
}

struct Lingering(String);

impl Dial for Lingering {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            let unreachable = |_| Fault::Link(LinkFault::Unreachable);
            let stream = TcpStream::connect(&self.0).await.map_err(unreachable)?;
            stream.set_nodelay(true).map_err(unreachable)?;
            Ok(Connection::ModbusTcp(ModbusTcp::new(stream, tap)))
        })
    }
}
