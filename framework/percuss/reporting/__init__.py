"""What percuss shows: tables in the terminal, figures, and the page of a study."""
