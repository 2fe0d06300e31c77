"""What each paper prints, as `visref.papers.published` has it: one module each."""
