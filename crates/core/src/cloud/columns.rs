//! serde for `[Vec<f64>; K]`, which the derive does not cover for a generic K.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

pub fn serialize<S: Serializer, const K: usize>(
    columns: &[Vec<f64>; K],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    columns.as_slice().serialize(serializer)
}

pub fn deserialize<'de, D: Deserializer<'de>, const K: usize>(
    deserializer: D,
) -> Result<[Vec<f64>; K], D::Error> {
    let columns = Vec::<Vec<f64>>::deserialize(deserializer)?;
    columns
        .try_into()
        .map_err(|c: Vec<_>| D::Error::custom(format!("{} linear columns where {K} are expected", c.len())))
}
