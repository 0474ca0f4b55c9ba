//! State of a navigator to bytes and back.

use serde::{Serialize, de::DeserializeOwned};

use crate::error::Error;

/// State to bytes.
///
/// # Errors
/// [`Error::Snapshot`].
pub fn save<T: Serialize>(state: &T) -> Result<Vec<u8>, Error> {
    postcard::to_stdvec(state).map_err(|e| Error::Snapshot(e.to_string()))
}

/// Bytes to state.
///
/// # Errors
/// [`Error::Snapshot`].
pub fn load<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Error> {
    postcard::from_bytes(bytes).map_err(|e| Error::Snapshot(e.to_string()))
}
