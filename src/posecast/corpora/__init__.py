"""Named corpora, one a file: which files, splits, joints, frame rate, known faults."""
