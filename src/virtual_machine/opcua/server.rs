//! Connections of clients. The server forwards their bytes to the library, until a fault replaces an answer.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use rand::RngExt;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Mutex, mpsc, watch};

use super::library::{Endpoint, Library};
use super::line::{Cut, NodeLine};
use crate::virtual_machine::listener::{self, Switch};
use crate::virtual_machine::random::stream;

/// Maximum number of bytes that are forwarded in one step.
const PIECE: usize = 16 * 1024;
/// Interval of the checks whether a silent device answers again.
const SILENT: Duration = Duration::from_millis(20);

/// Virtual OPC UA server of one bus. It passes the bytes of its clients to a server of the OPC UA library.
pub(in crate::virtual_machine) struct NodeServer {
    line: Arc<NodeLine>,
    library: Arc<Mutex<Library>>,
}

impl NodeServer {
    /// Starts the OPC UA library to which the new server passes its connections.
    ///
    /// # Errors
    /// The library cannot be started.
    pub(in crate::virtual_machine) async fn start(
        line: NodeLine,
        endpoint: &Endpoint,
    ) -> io::Result<NodeServer> {
        let line = Arc::new(line);
        let library = Arc::new(Mutex::new(Library::start(endpoint, &line).await?));
        Ok(NodeServer { line, library })
    }

    /// Serves clients on a listener, until `stop` changes or its sender is dropped.
    pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
        self,
        listener: TcpListener,
        switched: mpsc::Receiver<S>,
        stop: watch::Receiver<bool>,
    ) -> io::Result<()> {
        let converse = move |client: TcpStream| relay(client, self.line.clone(), self.library.clone());
        listener::serve(listener, switched, stop, converse).await
    }
}

/// Serves one connection, until the client or the library closes it, or the device is started again.
async fn relay(client: TcpStream, line: Arc<NodeLine>, library: Arc<Mutex<Library>>) -> io::Result<()> {
    let cuts = line.cuts();
    let (server, boots) = library.lock().await.connect(&line).await?;
    pass_on(client, server, &line, (cuts, boots)).await
}

/// Forwards bytes between a client and the library, until one of the two closes the connection. `boots` is
/// the number of starts of the device at the beginning. If the device is started again, the connection ends
/// too.
pub(super) async fn pass_on<S: AsyncRead + AsyncWrite>(
    client: S,
    server: S,
    line: &NodeLine,
    (mut cuts, boots): (watch::Receiver<Cut>, u16),
) -> io::Result<()> {
    let (mut from_client, mut to_client) = tokio::io::split(client);
    let (mut from_server, mut to_server) = tokio::io::split(server);
    let (mut asked, mut answered) = (vec![0; PIECE], vec![0; PIECE]);
    // Number of bytes of an answer that are not sent yet.
    let mut held = 0;
    loop {
        tokio::select! {
            read = from_client.read(&mut asked) => {
                let count = read?;
                if count == 0 || line.boots() != boots {
                    return Ok(());
                }
                to_server.write_all(&asked[..count]).await?;
            }
            read = from_server.read(&mut answered), if held == 0 => {
                held = read?;
                if held == 0 {
                    return Ok(());
                }
            }
            () = tokio::time::sleep(SILENT), if held > 0 => {}
        }
        if held == 0 || line.is_silent() {
            continue;
        }
        match next_cut(&mut cuts) {
            Cut::None => to_client.write_all(&answered[..held]).await?,
            Cut::Close => return Ok(()),
            Cut::Mute => while from_client.read(&mut asked).await? > 0 {},
            Cut::Garbage => {
                let bytes: [u8; 16] = stream(u64::from(boots), "garbage").random();
                to_client.write_all(&bytes).await?;
            }
        }
        held = 0;
    }
}

/// Returns the fault of the next answer. Each fault is returned only once; afterwards, `Cut::None` is returned.
fn next_cut(cuts: &mut watch::Receiver<Cut>) -> Cut {
    if cuts.has_changed().unwrap_or(false) { *cuts.borrow_and_update() } else { Cut::None }
}
