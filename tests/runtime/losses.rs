//! What is lost is counted, shown and told.
