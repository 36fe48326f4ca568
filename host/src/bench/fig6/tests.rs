use super::*;

fn set_up() -> SetUp {
    SetUp::parse(screed_fixtures::FIG6).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_few_runs_come_near_the_aims_and_the_raw_figures_are_the_papers() {
    let set_up = set_up();
    for case in set_up.cases.iter().filter(|case| case.aim_m.is_some()) {
        let score = Score::of(&set_up, case, [501, 503]).unwrap_or_else(|error| panic!("{error}"));
        let raw = score.raw;
        assert!((raw.position[0] - 0.16).abs() < 0.002 && (raw.position[1] - 0.067).abs() < 0.002, "{raw:?}");
        let angle = raw.rotation.map(f64::to_degrees);
        assert!((angle[0] - 9.1).abs() < 0.15 && (angle[1] - 3.87).abs() < 0.1, "{angle:?}");
        let (place, turn) = (score.filtered.position[0], score.filtered.rotation[0].to_degrees());
        assert!(place < 1.1 * case.aim_m.unwrap_or(0.0) && turn < 1.1 * case.aim_deg.unwrap_or(0.0), "{place} {turn}");
        assert!(score.smoothed.position[0] < 0.8 * place, "{:?}", score.smoothed);
        assert!((1.5..4.5).contains(&score.nees_place.mean), "{:?}", score.nees_place);
    }
}

#[test]
fn a_filter_that_is_not_what_it_believes_is_told_beside_what_could_be_done() {
    let errors = |place, turn| Errors { position: [place, 0.0], rotation: [f64::to_radians(turn), 0.0] };
    let score = |mean| Score {
        raw: errors(0.16, 9.0),
        filtered: errors(0.05, 3.0),
        smoothed: errors(0.04, 2.0),
        nees: Nees { mean, band: [16.0, 20.0], inside: 0.25 },
        nees_place: Nees { mean: 3.0, band: [2.5, 3.5], inside: 0.95 },
        covered: 0.99,
        runs: 20,
    };
    let set_up = set_up();
    let told = |mean| report::table(&[(&set_up.cases[0], score(mean))]);
    let above = told(24.0);
    assert!(above.contains("whole state (18): 24.00, ABOVE its band"), "{above}");
    assert!(above.contains("place (3): 3.00, in its band (2.50 to 3.50; 95 % of the instants in it)"), "{above}");
    assert!(above.contains("0.0400 m, 2.00°; the filter 0.0500 m, 3.00°: 1.25 and 1.50 times that"), "{above}");
    assert!(told(10.0).contains("whole state (18): 10.00, BELOW its band"));
    assert!(told(18.0).contains("whole state (18): 18.00, in its band"));
    let json = report::json(&[(&set_up.cases[0], score(24.0))]);
    assert_eq!(
        (&json[0]["nees_state"]["mean_in_band"], &json[0]["nees_place"]["mean_in_band"]),
        (&false.into(), &true.into())
    );
}

#[test]
fn a_run_is_the_same_again_and_another_with_another_seed() {
    let set_up = set_up();
    let last = |seed| run(&set_up, &set_up.cases[0], seed).unwrap_or_default().pop().map(|sample| sample.filtered);
    assert!(last(1).is_some() && last(1) == last(1) && last(1) != last(2));
}

#[test]
fn descriptions_without_sense_are_refused() {
    let good = screed_fixtures::FIG6;
    for (from, to, expected) in [
        ("robot = \"ur10e\"", "robot = \"r2\"", "expected robot"),
        ("missing = 0.5", "missing = 1.0", "share"),
        ("duration_s = 40.0", "duration_s = 1.0", "more than unscored_s"),
        ("duration_s = 40.0", "duration_s = nan", "positive"),
        ("position_rad = 0.1", "position_rad = 0.0", "[start]"),
        ("tune = [2001, 2048]", "tune = [2001, 3001]", "[seeds]"),
        ("period_ms = 8.0", "period_ms = -8.0", "positive"),
        ("robot =", "robots =", "robots"),
    ] {
        assert!(good.contains(from), "{from}");
        let message =
            SetUp::parse(&good.replacen(from, to, 1)).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains(expected), "{to}: {message}");
    }
}

#[test]
fn the_drawing_is_well_formed() {
    let set_up = set_up();
    let samples = run(&set_up, &set_up.cases[0], 1).unwrap_or_default();
    let drawing = plot::svg(&set_up.cases[0], 1, &samples);
    assert!(!drawing.contains("NaN") && !drawing.contains("inf"));
    assert_eq!(drawing.matches("<text ").count(), drawing.matches("</text>").count());
    assert!(drawing.matches("<circle").count() > 500 && drawing.len() < 400_000, "{}", drawing.len());
    if let Ok(path) = std::env::var("SCREED_PLOT") {
        std::fs::write(path, drawing).unwrap_or_else(|error| panic!("{error}"));
    }
}
