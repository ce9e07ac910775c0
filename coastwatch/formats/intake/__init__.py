"""What all formats share: times of records, which records are accepted, counts of those that are not."""
