//! The page's certificate: read from its files, and read again when they change.

use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use tokio::sync::watch;
use tokio_rustls::rustls::ServerConfig;

use crate::fieldbus::tls;
use crate::observe::http::Shown;
use isotherm_profile::{WebTls, regular};

/// How often it is looked whether the files have changed. What has is read when it has stayed so from one look to the next:
/// two files cannot be changed at once.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// What is shown, and the files that it comes from.
#[derive(Debug)]
pub(super) struct Certificate {
    files: WebTls,
    read: Stamp,
    show: watch::Sender<Arc<ServerConfig>>,
}

/// By what the two files are known to be others than before.
type Stamp = [Option<(u64, u64, i64, i64)>; 2];

impl Certificate {
    /// Reads the files.
    ///
    /// # Errors
    /// A sentence that names the file, and says what is wrong with it.
    pub(super) fn open(files: &WebTls) -> anyhow::Result<Certificate> {
        let read = stamp(files);
        Ok(Certificate { files: files.clone(), read, show: watch::Sender::new(Arc::new(config(files)?)) })
    }

    /// What is shown from now on.
    pub(super) fn shown(&self) -> Shown {
        self.show.subscribe()
    }

    /// Reads the files again whenever they change. Where there is something wrong with the new ones, the old are still shown.
    pub(super) async fn keep(mut self) {
        let mut last = self.read;
        loop {
            tokio::time::sleep(LOOK_EVERY).await;
            let files = self.files.clone();
            // A file may lie on a network that is gone; nobody else waits for it.
            let Ok(found) = tokio::task::spawn_blocking(move || stamp(&files)).await else { return };
            if found != self.read && found == last {
                self.read = found;
                let files = self.files.clone();
                let Ok(read) = tokio::task::spawn_blocking(move || config(&files)).await else { return };
                match read {
                    Ok(config) => {
                        self.show.send_replace(Arc::new(config));
                        tracing::info!("the page shows the new certificate in {}", self.files.cert.display());
                    }
                    Err(why) => tracing::warn!("the page still shows its old certificate: {why:#}"),
                }
            }
            last = found;
        }
    }
}

fn config(files: &WebTls) -> anyhow::Result<ServerConfig> {
    let read = |path: &Path| {
        regular::read(path, regular::LARGEST)
            .with_context(|| format!("the page's {} cannot be read (web.tls)", path.display()))
    };
    let (cert, key) = (read(&files.cert)?, read(&files.key)?);
    tls::server(&cert, &key).map_err(|wrong| {
        let (file, why) = match wrong {
            tls::Wrong::Cert(why) => (&files.cert, why),
            tls::Wrong::Key(why) => (&files.key, why),
        };
        anyhow::anyhow!("the page's {} (web.tls): {why}", file.display())
    })
}

fn stamp(files: &WebTls) -> Stamp {
    [&files.cert, &files.key].map(|path| {
        let found = std::fs::metadata(path).ok()?;
        Some((found.ino(), found.size(), found.mtime(), found.mtime_nsec()))
    })
}
