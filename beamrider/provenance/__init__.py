"""What made a result: sources by their meaning, versions of libraries, arguments, digests of inputs."""
