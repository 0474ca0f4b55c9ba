//! Options of every packaged navigator: what is refused, and that bounds are those of the constructors.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use serde_json::{Map, Value, json};
use uwcoop_core::error::Error;
use uwcoop_core::navigator::packaged::{Options, PACKAGED, Packaged, make_central, make_navigator};
use uwcoop_core::navigator::settings::Context;

const TEAM: usize = 3;

fn context() -> Context<'static> {
    Context { vehicle: 1, vehicles: TEAM, sound_speed_mps: 1500.0, seed: 4, ranging: &[false, true, false] }
}

fn build(one: &Packaged, options: &Options) -> Result<(), Error> {
    if one.method.central {
        make_central(one.name, &context(), options).map(drop)
    } else {
        make_navigator(one.name, &context(), options, None).map(drop)
    }
}

fn refusal(one: &Packaged, options: &Options) -> String {
    build(one, options).expect_err(one.name).to_string()
}

/// The options of a navigator that it reads and that are its own to set, with their defaults.
fn free(one: &Packaged) -> Map<String, Value> {
    let described = one.method.describe().unwrap();
    let unread = one.unread(&Map::new()).unwrap();
    let fixed = one.fixed().unwrap();
    let defaults = described["defaults"].as_object().unwrap().clone();
    defaults
        .into_iter()
        .filter(|(option, _)| !fixed.contains_key(option) && unread.iter().all(|(name, _)| name != option))
        .collect()
}

#[test]
fn every_navigator_is_made_from_its_defaults_stated_or_not() {
    assert!(PACKAGED.len() > 20);
    for one in PACKAGED {
        build(one, &Map::new()).unwrap();
        build(one, &free(one)).unwrap_or_else(|error| panic!("{}: {error}", one.name));
        build(one, &one.fixed().unwrap()).unwrap();
    }
}

#[test]
fn an_option_that_there_is_not_is_refused_by_name() {
    for one in PACKAGED {
        let said = refusal(one, json!({ "partikles": 7 }).as_object().unwrap());
        assert_eq!(said, format!("navigator.{}.partikles: no such option", one.name));
    }
}

#[test]
fn an_option_of_a_relative_is_refused_with_the_reason() {
    let mut seen = 0;
    for one in PACKAGED {
        let described = one.method.describe().unwrap();
        for (option, reason) in described["without"].as_object().unwrap() {
            let said = refusal(one, &Map::from_iter([(option.clone(), json!(1))]));
            assert_eq!(said, format!("navigator.{}.{option}: {}", one.name, reason.as_str().unwrap()));
            seen += 1;
        }
    }
    assert!(seen > 5);
}

#[test]
fn what_is_not_read_is_refused_with_the_reason_even_at_its_default() {
    let mut seen = 0;
    for one in PACKAGED {
        let described = one.method.describe().unwrap();
        let fixed = one.fixed().unwrap();
        for (option, reason) in one.unread(&Map::new()).unwrap() {
            if fixed.contains_key(option) {
                continue;
            }
            let stated = Map::from_iter([(option.to_owned(), described["defaults"][option].clone())]);
            let said = refusal(one, &stated);
            assert_eq!(said, format!("navigator.{}.{option}: not read, because {reason}", one.name));
            seen += 1;
        }
    }
    assert!(seen > 40, "{seen}");
}

#[test]
fn a_fixed_option_is_not_anothers_to_change() {
    let one = PACKAGED.iter().find(|one| one.name == "terrain-only").unwrap();
    let said = refusal(one, json!({ "use_ranges": true }).as_object().unwrap());
    assert_eq!(said, "navigator.terrain-only.use_ranges: is true: this navigator has it at false");
}

#[test]
fn a_value_of_another_type_or_outside_its_bound_names_option_and_value() {
    for one in PACKAGED {
        let described = one.method.describe().unwrap();
        for (option, _) in free(one) {
            let said = refusal(one, &Map::from_iter([(option.clone(), json!({ "a": 1 }))]));
            assert!(said.contains(&option), "{said}");
        }
        for (option, bound) in described["bounds"].as_object().unwrap() {
            if !free(one).contains_key(option) {
                continue;
            }
            let mut outside = vec![];
            for (limit, value) in bound.as_object().unwrap() {
                let value = value.as_f64().unwrap();
                outside.push(match limit.as_str() {
                    "gt" | "lt" => value,
                    "ge" => value - 1.0,
                    _ => value + 1.0,
                });
            }
            for value in outside {
                // Whole numbers, so that counts are judged by their bound and not by their type.
                let value = if value.fract() == 0.0 { json!(value as i64) } else { json!(value) };
                let said = refusal(one, &Map::from_iter([(option.clone(), value.clone())]));
                assert!(
                    said.contains(option.as_str()) && said.contains(&value.to_string()),
                    "{}: {said}",
                    one.name
                );
            }
        }
    }
}

#[test]
fn every_value_inside_a_bound_is_taken() {
    for one in PACKAGED {
        let described = one.method.describe().unwrap();
        let own = free(one);
        for (option, bound) in described["bounds"].as_object().unwrap() {
            let Some(default) = own.get(option) else { continue };
            let limit = |name: &str| bound.get(name).and_then(Value::as_f64);
            let whole = default.is_u64() || option == "range_samples";
            let mut inside: Vec<f64> = [limit("ge"), limit("le")].into_iter().flatten().collect();
            inside.extend(limit("gt").map(|least| least + if whole { 1.0 } else { 1e-3 }));
            inside.extend(limit("lt").map(|most| most - 1e-3));
            for value in inside {
                // A cloud of ten million is memory, not a bound; quorum and speeds are bounded by one another.
                if value > 1e5 || ["consensus_window", "speed_max_mps"].contains(&option.as_str()) {
                    continue;
                }
                let stated = if whole { json!(value as u64) } else { json!(value) };
                let mut options = Map::from_iter([(option.clone(), stated)]);
                match option.as_str() {
                    "frame_bytes" => _ = options.insert("tag_bytes".into(), json!(0)),
                    "tag_bytes" => _ = options.insert("frame_bytes".into(), json!(64)),
                    "speed_min_mps" => continue,
                    "consensus_quorum" => continue,
                    _ => {}
                }
                // Below ten, particles are either none or refused by the navigator itself.
                if build(one, &options).is_err_and(|_| !(option == "frame_bytes" && value < 22.0)) {
                    panic!("{}.{option} = {value}: {}", one.name, refusal(one, &options));
                }
            }
        }
    }
}

#[test]
fn a_team_drift_names_every_vehicle() {
    let one = PACKAGED.iter().find(|one| one.name == "team").unwrap();
    let said = refusal(one, json!({ "team_drift": ["dvl", "no-dvl"] }).as_object().unwrap());
    assert_eq!(said, "navigator.team.team_drift: names 2 vehicles: the team has 3");
    build(one, json!({ "team_drift": ["dvl", "no-dvl", "table-1"] }).as_object().unwrap()).unwrap();
}

#[test]
fn central_and_single_are_not_taken_for_each_other() {
    assert!(make_navigator("cekf", &context(), &Map::new(), None).is_err());
    assert!(make_central("mpf", &context(), &Map::new()).is_err());
    let unknown = make_navigator("mpff", &context(), &Map::new(), None).err().unwrap().to_string();
    assert!(unknown.contains("mpff") && unknown.contains("dead-reckoning"), "{unknown}");
}
