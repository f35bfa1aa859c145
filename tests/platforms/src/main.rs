//! Prints the fingerprints of each SIMD level of this machine, or with `--new` those of the lowest
//! alone, as the list has them. Exit code 1 if a level differs from the list.

use bvh_core::SimdLevel;
use pivot_fingerprints::{LIST, fingerprints, text};

fn main() {
    if std::env::args().nth(1).as_deref() == Some("--new") {
        print!("{}", text(&fingerprints(SimdLevel::Baseline)));
        return;
    }
    let mut differences = 0;
    for level in SimdLevel::available() {
        let found = text(&fingerprints(level));
        let count = LIST.lines().count().max(found.lines().count());
        let (mut listed, mut new) = (LIST.lines(), found.lines());
        let mut wrong = 0;
        for _ in 0..count {
            let pair = (listed.next(), new.next());
            if pair.0 != pair.1 {
                println!("  {level}: listed {:?}, found {:?}", pair.0, pair.1);
                wrong += 1;
            }
        }
        println!("{}, {level}: {count} fingerprints, {wrong} differences", std::env::consts::ARCH);
        differences += wrong;
    }
    std::process::exit(i32::from(differences > 0));
}
