"""What tests of several rooms use: meshes and cases, references written apart, programs to look with."""
