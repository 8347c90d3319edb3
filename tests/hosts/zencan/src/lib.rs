//! Nothing of its own: the tests drive a virtual head with zencan-client.
