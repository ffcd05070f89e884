//! Bare loops of tokio-modbus, as in its examples.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio_modbus::client::{Context, Reader, Writer, tcp};
use tokio_modbus::slave::Slave;

use super::Work;

pub(super) fn closed_loop(port: u16) {
    block_on(async {
        let mut device = connected(0, port).await;
        loop {
            one_loop(&mut device, false).await;
        }
    });
}

pub(super) fn fleet(port: u16, work: &Work) {
    let Work { devices, period, reads_only } = *work;
    block_on(async {
        let tasks: Vec<_> =
            (0..devices).map(|device| tokio::spawn(polled(device, port, period, reads_only))).collect();
        for task in tasks {
            task.await.unwrap();
        }
    });
}

async fn polled(device: u16, port: u16, period: Duration, reads_only: bool) {
    let mut device = connected(device, port).await;
    let mut ticks = tokio::time::interval(period);
    loop {
        ticks.tick().await;
        one_loop(&mut device, reads_only).await;
    }
}

fn block_on(work: impl Future<Output = ()>) {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(work);
}

async fn connected(device: u16, port: u16) -> Context {
    let [net, host] = [device / 250, device % 250 + 1].map(|part| u8::try_from(part).unwrap());
    let address = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(127, 0, net, host)), port);
    let stream = tokio::net::TcpStream::connect(address).await.unwrap();
    stream.set_nodelay(true).unwrap();
    tcp::attach_slave(stream, Slave(1))
}

/// Executes one loop: Cz = 2.4 µm/°C · (bed − wheelhead), in counts of 0.1 µm.
async fn one_loop(device: &mut Context, reads_only: bool) {
    let registers = device.read_input_registers(0, 8).await.unwrap().unwrap();
    if !reads_only {
        let [bed, wheelhead] = [registers[0], registers[1]].map(|register| f64::from(register.cast_signed()));
        #[allow(clippy::cast_possible_truncation, reason = "a few hundred counts")]
        let counts = (2.4 * (bed - wheelhead)) as i16;
        device.write_single_register(10, counts.cast_unsigned()).await.unwrap().unwrap();
    }
}
