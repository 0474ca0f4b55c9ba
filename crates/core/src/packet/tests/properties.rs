//! Properties over random values: what is read is what was written, rounded to the safe side.

use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn bits_come_back(values in prop::collection::vec((any::<u64>(), 0u32..=64), 0..40)) {
        let mut writer = BitWriter::with_capacity(8);
        let cut = |value: u64, bits: u32| if bits == 0 { 0 } else { value >> (64 - bits) };
        for &(value, bits) in &values {
            if bits < 64 {
                prop_assert!(writer.push("v", cut(value, bits) | 1 << bits, bits).is_err());
            }
            writer.push("v", cut(value, bits), bits).unwrap();
        }
        let total: usize = values.iter().map(|(_, bits)| *bits as usize).sum();
        prop_assert_eq!(writer.bit_len(), total);
        let bytes = writer.finish();
        prop_assert_eq!(bytes.len(), total.div_ceil(8));
        let mut reader = BitReader::new(&bytes);
        for &(value, bits) in &values {
            prop_assert_eq!(reader.take("v", bits).unwrap(), cut(value, bits));
        }
        let before = reader.clone();
        prop_assert!(reader.take("v", 9).is_err());
        prop_assert_eq!(&reader, &before);
        reader.finish().unwrap();
    }

    #[test]
    fn fixed_fields_come_back_within_their_rounding(
        bits in 1u32..=52, steps in 1e-3f64..1e3, signed: bool, share in -1.0f64..1.0, mode in 0usize..4,
    ) {
        let rounding = [Rounding::Nearest, Rounding::Up, Rounding::Down, Rounding::TowardZero][mode];
        let field = FixedField { name: "x", unit: "m", bits, steps_per_unit: steps, signed, rounding };
        let value = share * f64::from(bits).exp2() / steps;
        let mut writer = BitWriter::default();
        let (lowest, highest) = if signed {
            (-f64::from(bits - 1).exp2(), f64::from(bits - 1).exp2() - 1.0)
        } else {
            (0.0, f64::from(bits).exp2() - 1.0)
        };
        match field.write(&mut writer, value) {
            Ok(()) => {
                let bytes = writer.finish();
                let read = field.read(&mut BitReader::new(&bytes)).unwrap();
                let off = (read - value) * steps;
                let rounding_error = 1e-15 * (value * steps).abs();
                match rounding {
                    Rounding::Nearest => prop_assert!(off.abs() <= 0.5 + rounding_error),
                    Rounding::Up => prop_assert!((-rounding_error..1.0 + rounding_error).contains(&off)),
                    Rounding::Down => prop_assert!((-1.0 - rounding_error..=rounding_error).contains(&off)),
                    Rounding::TowardZero => prop_assert!(off * value.signum() <= rounding_error),
                }
            }
            Err(error) => {
                let out_of_range = matches!(error, PacketError::OutOfRange { .. });
                prop_assert!(out_of_range);
                prop_assert!(value * steps < lowest || value * steps > highest);
            }
        }
    }

    #[test]
    fn angles_come_back_modulo_a_turn(angle in -1e4f64..1e4, bits in 1u32..=52) {
        let field = AngleField { name: "a", bits };
        let mut writer = BitWriter::default();
        field.write(&mut writer, angle).unwrap();
        let bytes = writer.finish();
        let read = field.read(&mut BitReader::new(&bytes)).unwrap();
        prop_assert!((-PI..PI).contains(&read));
        let off = (read - angle + PI).rem_euclid(TAU) - PI;
        prop_assert!(off.abs() <= field.step_rad() / 2.0 + 1e-11);
    }

    #[test]
    fn counters_unwrap_to_the_nearest(reference: u64, offset in -200i64..200, bits in 1u32..=63) {
        let field = ModuloField { name: "m", bits };
        let counter = reference.saturating_add_signed(offset);
        let unwrapped = field.unwrap_near(field.residue(counter).unwrap(), reference).unwrap();
        prop_assert_eq!(field.residue(unwrapped), field.residue(counter));
        let half = 1u64 << (bits - 1);
        let near = if counter >= reference { counter - reference < half } else { reference - counter <= half };
        if near {
            prop_assert_eq!(unwrapped, counter);
        }
    }

    #[test]
    fn sigmas_round_up_and_correlations_toward_zero(sigma in 0.0f64..4000.0, correlation in -1.0f64..=1.0) {
        let field = SigmaField { name: "s", unit: "m", bits: 7, steps_per_octave: 8, lowest_log2: -3 };
        let mut writer = BitWriter::default();
        if field.write(&mut writer, sigma).is_ok() {
            let bytes = writer.finish();
            let read = field.read(&mut BitReader::new(&bytes)).unwrap();
            prop_assert!(read >= sigma && read < sigma.max(0.125) * 1.0906);
        } else {
            prop_assert!(sigma > field.decode(127));
        }
        let field = CorrelationField { name: "r", bits: 7, steps_per_unit: 16.0 };
        let code = field.encode(correlation).unwrap();
        let read = field.decode(code);
        prop_assert!(read.abs() <= correlation.abs() && read * correlation >= 0.0);
        prop_assert!(code.abs() == 63 || correlation.abs().atanh() - read.abs().atanh() < 1.0 / 16.0 + 1e-9);
    }

    #[test]
    fn floats_come_back_bit_for_bit(raw: u64) {
        let field = FloatField { name: "f" };
        let value = f64::from_bits(raw);
        let mut writer = BitWriter::default();
        prop_assert_eq!(field.write(&mut writer, value).is_ok(), value.is_finite());
        let read = field.read(&mut BitReader::new(&raw.to_be_bytes()));
        prop_assert_eq!(read.map(f64::to_bits).ok(), value.is_finite().then_some(raw));
    }

    #[test]
    fn a_belief_is_never_overstated_nor_much_understated(
        mean in (-32_768.0f64..32_767.9, -32_768.0f64..32_767.9),
        log_sigma in (-8.0f64..11.8, -8.0f64..11.8), atanh in -6.0f64..6.0,
        depth_m in 0.0f64..11_000.0, sequence: u8, heard: u16, sender: u16, tol_ns: i64,
    ) {
        let sigma = (log_sigma.0.exp2(), log_sigma.1.exp2());
        let mut sent = packet(PacketKind::Belief, mean, sigma, atanh.tanh());
        sent.header = Header { kind: PacketKind::Belief, sequence, depth_m, heard: HeardBitmap::from_bits(heard) };
        let bytes = sent.encode(sender, tol_ns).unwrap();
        prop_assert_eq!(bytes.len(), BELIEF_BYTES);
        let got = BeliefPacket::decode(&bytes, sender, tol_ns).unwrap();
        prop_assert!((got.header.depth_m - depth_m).abs() <= 0.5 * Header::depth_step_m(depth_m) + 1e-9);
        prop_assert_eq!((got.header.sequence, got.header.heard.bits()), (sequence, heard));
        let error = got.belief.mean_m - sent.belief.mean_m;
        prop_assert!(error.amax() <= 1.0 / 32.0);

        let wanted = sent.belief.covariance_m2 + Matrix2::identity() / 512.0;
        let slack = got.belief.covariance_m2 - wanted;
        prop_assert!(least_eigenvalue(&slack) >= -1e-12 * got.belief.covariance_m2.trace());
        // Sigmas: three codes at most; below the field's range, its least value.
        let limit = |wanted: f64| (wanted.sqrt().max(1.0 / 16.0) * (3.0 / 16.0f64).exp2() * 1.000_001).powi(2);
        prop_assert!(got.belief.covariance_m2.m11 <= limit(wanted.m11));
        prop_assert!(got.belief.covariance_m2.m22 <= limit(wanted.m22));
        // The sum of both errors, correlation's included, stays small where the fields hold the shape.
        let within = wanted.m12.abs() < 0.99 * (wanted.m11 * wanted.m22).sqrt() && wanted.m11.min(wanted.m22) > 0.004;
        if within {
            prop_assert!(got.belief.covariance_m2.determinant() / wanted.determinant() < 1.6f64);
        }
    }

    #[test]
    fn an_unrounded_belief_comes_back_exactly(
        mean in (-1e9f64..1e9, -1e9f64..1e9), sigma in (0.0f64..1e6, 0.0f64..1e6), correlation in -1.0f64..=1.0,
    ) {
        let sent = packet(PacketKind::BeliefF64, mean, sigma, correlation);
        let bytes = sent.encode(7, -5).unwrap();
        prop_assert_eq!(bytes.len(), BELIEF_F64_BYTES);
        prop_assert_eq!(BeliefPacket::decode(&bytes, 7, -5).unwrap(), sent);
    }

    #[test]
    fn any_covariance_gives_a_packet_or_a_typed_error(raw in prop::array::uniform6(any::<u64>())) {
        let [e, n, ee, en, ne, nn] = raw.map(f64::from_bits);
        let belief = Belief { mean_m: Vector2::new(e, n), covariance_m2: Matrix2::new(ee, en, ne, nn) };
        for kind in [PacketKind::Belief, PacketKind::BeliefF64] {
            let _ = BeliefPacket { header: header(kind), belief }.encode(0, 0);
        }
    }
}
