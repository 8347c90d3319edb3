//! A serial port for slcan: a pseudo-terminal that looks like an adapter on a USB port.
//!
//! The line is raw, and its far end is kept open here as well: clients come and go, and their input is never echoed or
//! turned into lines.

use crate::client::{Chunk, Client, Protocol, Report, TooSlow};
use crate::hub::{Hub, Port};
use crate::slcan::Slcan;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use std::fs;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

/// How long to wait for a file before looking whether the wait is still valid.
const PATIENCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// A serial port. Dropping it ends the conversation and removes the link.
pub struct SerialPort {
    client: Arc<Client>,
    device: PathBuf,
    link: PathBuf,
}

impl SerialPort {
    /// Opens a pseudo-terminal and makes `link` point to it. A link that is left over from an earlier one is replaced.
    ///
    /// # Errors
    /// When there is something else at `link`, or the system has no pseudo-terminals left.
    pub fn new(hub: &Hub, link: &Path, report: Report) -> io::Result<SerialPort> {
        let near = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&near)?;
        unlockpt(&near)?;
        let name = ptsname(&near, Vec::new())?;
        let device = PathBuf::from(name.to_str().map_err(io::Error::other)?);
        let far = rustix::fs::open(&device, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
        raw(&far)?;
        fcntl_setfl(&near, OFlags::RDWR | OFlags::NONBLOCK)?;

        if fs::read_link(link).is_ok_and(|target| target.starts_with("/dev/pts")) {
            fs::remove_file(link)?;
        }
        symlink(&device, link)?;

        let client =
            Arc::new(Client::new(link.display().to_string(), Box::new(Slcan::default()), TooSlow::HangUp, report));
        let port = hub.attach(client.clone());
        converse(client.clone(), port, Arc::new(near), Arc::new(far));
        Ok(SerialPort { client, device, link: link.into() })
    }

    /// The pseudo-terminal that the link points to.
    pub fn device(&self) -> &Path {
        &self.device
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        self.client.end();
        if fs::read_link(&self.link).is_ok_and(|target| target == self.device) {
            // Nothing that could be done if it stays.
            let _ = fs::remove_file(&self.link);
        }
    }
}

/// Joins a bus behind the adapter at a serial port. The speed of the serial line does not matter on USB.
pub(crate) fn connect(
    hub: &Hub,
    device: &Path,
    protocol: Box<dyn Protocol>,
    report: &Report,
) -> io::Result<Arc<Client>> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let line = Arc::new(rustix::fs::open(device, flags, Mode::empty())?);
    raw(&*line)?;
    let client = Arc::new(Client::new(device.display().to_string(), protocol, TooSlow::HangUp, report.clone()));
    let port = hub.attach(client.clone());
    converse(client.clone(), port, line.clone(), line);
    Ok(client)
}

/// Bytes as they are: no echo, no lines.
fn raw(fd: impl AsFd) -> io::Result<()> {
    let mut settings = tcgetattr(&fd)?;
    settings.make_raw();
    Ok(tcsetattr(&fd, OptionalActions::Now, &settings)?)
}

/// Leads a conversation by two threads. `far`: where what has not been read waits.
fn converse(client: Arc<Client>, port: Port, near: Arc<OwnedFd>, far: Arc<OwnedFd>) {
    let (reader, reads, kept) = (client.clone(), near.clone(), far.clone());
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        while !reader.ended() {
            match ready(&reads, PollFlags::IN).and_then(|()| rustix::io::read(&reads, &mut bytes)) {
                // The adapter is gone.
                Ok(0) => reader.end(),
                Ok(length) => reader.receive(&bytes[..length], &port),
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(_) => reader.end(),
            }
        }
        drop(kept);
    });
    thread::spawn(move || client.write_to(|chunk| write(&near, &far, chunk)));
}

/// Waits until a file can be read or written; `AGAIN` when it could not for a while.
pub(crate) fn ready(fd: &impl AsFd, what: PollFlags) -> Result<(), Errno> {
    match poll(&mut [PollFd::new(fd, what)], Some(&PATIENCE))? {
        0 => Err(Errno::AGAIN),
        _ => Ok(()),
    }
}

/// Writes bytes as fast as they are read, until they are not valid any more.
fn write(near: &OwnedFd, far: &OwnedFd, chunk: &Chunk<'_>) -> io::Result<()> {
    if chunk.fresh {
        tcflush(far, QueueSelector::IFlush)?;
    }
    let mut rest = chunk.bytes;
    while !rest.is_empty() && (chunk.wanted)() {
        match ready(near, PollFlags::OUT).and_then(|()| rustix::io::write(near, rest)) {
            Ok(written) => rest = &rest[written..],
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
