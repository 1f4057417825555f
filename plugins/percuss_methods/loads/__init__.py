"""The load amplitudes that come with percuss."""
