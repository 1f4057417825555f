"""The output of percuss: tables on a terminal, figures, and the HTML page of a study."""
