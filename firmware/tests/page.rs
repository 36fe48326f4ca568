//! The code that the porting page shows is the code that runs.

#[test]
fn the_page_shows_the_real_files() {
    let page = include_str!("../../docs/porting-board.md");
    for (name, file) in
        [("main.rs", include_str!("../src/board/main.rs")), ("mps2.rs", include_str!("../src/board/mps2.rs"))]
    {
        assert!(page.contains(&format!("```rust\n{file}```\n")), "docs/porting-board.md shows another {name}");
    }
}
