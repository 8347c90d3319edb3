//! Writes that came too fast, or too late.
