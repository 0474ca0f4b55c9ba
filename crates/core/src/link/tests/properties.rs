//! Properties of the link over random sequences.

use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn the_window_agrees_with_a_full_memory(
        order in prop::collection::vec((0u64..600, any::<bool>()), 1..300),
    ) {
        // Packets wander in around a rising front, some twice; launch time 3 s × counter.
        let mut window = ReceiveWindow::new();
        let mut memory: BTreeSet<u64> = BTreeSet::new();
        for (index, (jump, _)) in order.iter().enumerate() {
            let counter = (index as u64 + jump % 40).min(599);
            let before = window.clone();
            let result = window.accept((counter % 256) as u8, counter as i64 * 3 * SECOND);
            let oldest = memory.iter().rev().nth(ReceiveWindow::LENGTH - 1).or(memory.first()).copied();
            // The first packet heard gives the counter's zero: only its eight bits are known.
            let expected = !memory.contains(&counter) && oldest.is_none_or(|oldest| counter > oldest);
            prop_assert_eq!(result.is_ok(), expected, "{} {:?}", counter, result);
            match result {
                Ok(extended) => {
                    prop_assert_eq!(extended, counter);
                    memory.insert(counter);
                }
                Err(_) => prop_assert_eq!(&window, &before),
            }
        }
    }

    #[test]
    fn acknowledgements_agree_with_a_set(
        length in 1u32..=64, start in 0u64..1000,
        steps in prop::collection::vec((0u64..90, 0usize..3), 1..60),
    ) {
        let mut bitmap = AckBitmap::new(length).unwrap();
        let mut other = AckBitmap::new(64).unwrap();
        let (mut set, mut others, mut newest, mut others_newest) = (BTreeSet::new(), BTreeSet::new(), 0, 0);
        let covered = |newest: u64, counter: u64| counter + u64::from(length) > newest;
        for (index, &(jump, what)) in steps.iter().enumerate() {
            let counter = start + index as u64 * 3 + jump;
            match what {
                0 => {
                    newest = newest.max(counter);
                    let new = covered(newest, counter) && set.insert(counter);
                    prop_assert_eq!(bitmap.mark(counter), new);
                }
                1 => {
                    newest = newest.max(counter);
                    bitmap.advance(counter);
                }
                _ => {
                    others_newest = others_newest.max(counter);
                    other.mark(counter);
                    others.insert(counter);
                    others.retain(|c| c + 64 > others_newest);
                    bitmap.merge(&other);
                    newest = newest.max(others_newest);
                    set.extend(others.iter());
                }
            }
            set.retain(|c| covered(newest, *c));
            prop_assert_eq!(bitmap.received().collect::<Vec<_>>(), set.iter().rev().copied().collect::<Vec<_>>());
            prop_assert_eq!(bitmap.newest(), (!set.is_empty()).then_some(newest));
            prop_assert!((start..newest + 3).all(|c| bitmap.is_received(c) == set.contains(&c)));

            let mut writer = BitWriter::default();
            bitmap.write(&mut writer).unwrap();
            prop_assert_eq!(writer.bit_len(), bitmap.bits() as usize);
            let bytes = writer.finish();
            // The owner of the packets may have sent up to 255 more since.
            for ahead in [0, 1, 255] {
                let read = AckBitmap::read(&mut BitReader::new(&bytes), length, Some(newest + ahead)).unwrap();
                prop_assert_eq!(read.received().collect::<Vec<_>>(), bitmap.received().collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn any_times_and_ranges_give_a_typed_result(raw in prop::array::uniform5(any::<u64>()), tol: i64, toa: i64) {
        let [slant, a, b, sigma, gates] = raw.map(f64::from_bits);
        if let Ok(reduced) = slant_to_horizontal(slant, a, b, sigma, gates) {
            prop_assert!(reduced.range_m >= 0.0 && reduced.range_m.is_finite());
        }
        if let Ok(range) = range_m(tol, toa, slant) {
            prop_assert!(range > 0.0 && range.is_finite());
        }
        let _ = LinkConfig::new(raw[0] as usize, raw[1] as usize, a, b, sigma);
    }

    #[test]
    fn any_acknowledgement_bytes_give_a_typed_result(
        bytes in prop::collection::vec(any::<u8>(), 0..12), length in 0u32..70, last: Option<u64>,
    ) {
        if let Ok(bitmap) = AckBitmap::read(&mut BitReader::new(&bytes), length, last) {
            prop_assert!(bitmap.received().all(|counter| Some(counter) <= last));
        }
    }
}
