//! What outlives the power: the images of drive and node in one piece, so that no cut can part them.
//!
//! | bytes | content |
//! | --- | --- |
//! | 1 | bit 0: the image of the drive is there; bit 1: that of the node |
//! | [`DRIVE_IMAGE`](super::DRIVE_IMAGE) | settings and values of the profile |
//! | [`canopen::IMAGE`](crate::canopen::IMAGE) | communication parameters |
//!
//! What an image means, and whether it is fit to run, is the affair of drive and node.

use super::Drive;
use super::stored::IMAGE as DRIVE;
use crate::canopen::{Group, IMAGE as NODE, Node};

const APPLICATION: u8 = 1;
const COMMUNICATION: u8 = 2;

/// What is kept, maybe nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept([u8; Kept::LENGTH]);

impl Kept {
    /// Length, bytes.
    pub const LENGTH: usize = 1 + DRIVE + NODE;
    /// Nothing was ever stored.
    pub const NOTHING: Kept = Kept([0; Self::LENGTH]);

    /// What was read back; `None` when it has another length or unknown parts.
    pub fn from_bytes(bytes: &[u8]) -> Option<Kept> {
        let kept = Kept(*<&[u8; Self::LENGTH]>::try_from(bytes).ok()?);
        (kept.there() & !(APPLICATION | COMMUNICATION) == 0).then_some(kept)
    }

    /// What is to be written.
    pub fn bytes(&self) -> &[u8; Self::LENGTH] {
        &self.0
    }

    /// For [`Drive::restart`].
    pub fn application(&self) -> Option<&[u8]> {
        self.0.get(1..1 + DRIVE).filter(|_| self.there() & APPLICATION != 0)
    }

    /// For [`Node::boot`].
    pub fn communication(&self) -> Option<&[u8]> {
        self.0.get(1 + DRIVE..).filter(|_| self.there() & COMMUNICATION != 0)
    }

    /// Keeps what a group of objects is now.
    pub fn keep(&mut self, group: Group, drive: &Drive, node: &Node) {
        let [there, images @ ..] = &mut self.0;
        *there |= parts(group);
        let (application, communication) = images.split_at_mut(DRIVE);
        if group != Group::Communication {
            application.copy_from_slice(&drive.image());
        }
        if group != Group::Application {
            communication.copy_from_slice(&node.image());
        }
    }

    /// Forgets a group of objects.
    pub fn forget(&mut self, group: Group) {
        let [there, ..] = &mut self.0;
        *there &= !parts(group);
    }

    fn there(&self) -> u8 {
        let [there, ..] = self.0;
        there
    }
}

fn parts(group: Group) -> u8 {
    match group {
        Group::All => APPLICATION | COMMUNICATION,
        Group::Application => APPLICATION,
        Group::Communication => COMMUNICATION,
    }
}
