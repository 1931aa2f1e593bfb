//! Does one of the pieces that `benches/pieces` measures a number of times, for `bench-harness/instructions.sh`. Without arguments, lists
//! them: number, units of work, name, unit.
//!
//! `cargo run --release -p esvo-cpu --example pieces [-- NUMBER TIMES]`

#[path = "../benches/pieces/work.rs"]
mod work;

fn main() -> Result<(), work::Error> {
    let arguments: Vec<usize> = std::env::args().skip(1).map(|text| text.parse()).collect::<Result<_, _>>()?;
    let mut pieces = work::pieces()?;
    match arguments[..] {
        [] => {
            for (number, piece) in pieces.iter_mut().enumerate() {
                println!("{number}\t{}\t{}\t{}", (piece.work)(), piece.name, piece.unit);
            }
        }
        [number, times] => {
            let piece = pieces.get_mut(number).ok_or("expected the number of a piece")?;
            (0..times).for_each(|_| _ = (piece.work)());
        }
        _ => return Err("expected no argument, or NUMBER TIMES".into()),
    }
    Ok(())
}
