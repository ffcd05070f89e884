use super::*;

fn form(data_type: Option<DataType>, word_order: Option<WordOrder>, scale: f64) -> ValueFormat {
    ValueFormat { data_type, word_order, byte_swap: false, scale, offset: 0.0 }
}

fn read(form: &ValueFormat, words: &[u16]) -> Vec<String> {
    let values = form.values("holding:100".parse().unwrap(), &Answer::Registers(words.to_vec()));
    let way = |read: &Reading| format!("{} {}", read.way, read.value).trim().to_owned();
    values
        .iter()
        .map(|shown| {
            let readings: Vec<String> = shown.readings.iter().map(way).collect();
            format!("{} {} [{}] {}", shown.register, shown.modicon, shown.raw, readings.join(", "))
        })
        .collect()
}

#[test]
fn a_value_is_shown_with_both_its_numbers_and_its_registers() {
    let tenths = form(Some(DataType::I32), Some(WordOrder::MswFirst), 0.1);
    assert_eq!(
        read(&tenths, &[1, 0x86a0, 0xffff, 0xfffe]),
        ["holding:100 40101 [0001 86A0] 10000", "holding:102 40103 [FFFF FFFE] -0.2"]
    );
    assert_eq!(read(&form(Some(DataType::F32), Some(WordOrder::LswFirst), 1.0), &[0, 0x7fc0]).len(), 1);
}

#[test]
fn without_an_order_both_are_shown() {
    let unordered = form(Some(DataType::I32), None, 1.0);
    assert!(unordered.lacks_order());
    assert_eq!(read(&unordered, &[0, 1]), ["holding:100 40101 [0000 0001] msw-first 1, lsw-first 65536"]);
    let single = form(Some(DataType::I16), None, 1.0);
    assert!(!single.lacks_order());
    assert_eq!(read(&single, &[0xffec]), ["holding:100 40101 [FFEC] -20"]);
}

#[test]
fn without_a_type_a_register_is_unsigned_and_signed_where_that_differs() {
    let plain = form(None, None, 1.0);
    assert_eq!(
        read(&plain, &[7, 0xffec]),
        ["holding:100 40101 [0007] 7", "holding:101 40102 [FFEC] u16 65516, i16 -20"]
    );
}

#[test]
fn sixty_four_bits_keep_every_digit() {
    let long = form(Some(DataType::I64), Some(WordOrder::MswFirst), 1.0);
    assert!(read(&long, &[0x7fff, 0xffff, 0xffff, 0xffff])[0].ends_with(" 9223372036854775807"));
}

#[test]
fn bits_are_counted_one_by_one() {
    let bits = form(None, None, 1.0).values("coil:19".parse().unwrap(), &Answer::Bits(vec![true, false]));
    assert_eq!((bits[1].modicon.as_str(), bits[1].raw.as_str()), ("00021", "0"));
    assert_eq!(bits[0].readings[0].value, "1");
}
