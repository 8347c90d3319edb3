//! Standard input and Ctrl-C.

use edm_bus::mailbox::Mailbox;
use std::io::{BufRead, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};

/// What was typed, and whether to stop.
pub struct Console {
    lines: Receiver<String>,
    stop: Arc<AtomicBool>,
}

impl Console {
    /// Listens from now on; every word rings the mailbox.
    ///
    /// The end of the standard input stops the program when a person or another program holds the other end. When it comes
    /// from a file, or from nowhere as in the background, its end is ignored.
    ///
    /// # Errors
    /// When Ctrl-C cannot be caught.
    pub fn new(mailbox: &Arc<Mailbox>) -> Result<Console, String> {
        let stop = Arc::new(AtomicBool::new(false));
        let halt = {
            let (stop, mailbox) = (stop.clone(), mailbox.clone());
            move || {
                stop.store(true, Ordering::Release);
                mailbox.ring();
            }
        };
        ctrlc::set_handler(halt.clone()).map_err(|error| format!("Ctrl-C cannot be caught: {error}"))?;
        let (sender, lines) = channel();
        let mailbox = mailbox.clone();
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                let Ok(line) = line else { break };
                if sender.send(line).is_err() {
                    break;
                }
                mailbox.ring();
            }
            if is_held() {
                halt();
            }
        });
        Ok(Console { lines, stop })
    }

    /// Whether to stop; [`Console::line`] then gives whatever was typed before that.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    /// The oldest line that has not been read.
    pub fn line(&self) -> Option<String> {
        self.lines.try_recv().ok()
    }
}

/// Whether a person or a program holds the other end of the standard input.
#[cfg(unix)]
fn is_held() -> bool {
    use std::os::fd::AsFd;
    use std::os::unix::fs::FileTypeExt;
    let stdin = std::io::stdin();
    let kind = || stdin.as_fd().try_clone_to_owned().ok().and_then(|fd| std::fs::File::from(fd).metadata().ok());
    stdin.is_terminal() || kind().is_some_and(|data| data.file_type().is_fifo() || data.file_type().is_socket())
}

/// Whether a person holds the other end of the standard input.
#[cfg(not(unix))]
fn is_held() -> bool {
    std::io::stdin().is_terminal()
}
