"""What is told of numbers from several patients; functions know numbers and patients, nothing of trunks."""
