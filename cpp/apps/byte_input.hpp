// Bytes of a file, a FIFO or standard input, with a wait that signals end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace ocisac::apps {

class ByteInput {
 public:
  // "-": standard input. Refused (std::invalid_argument): what cannot be opened. A FIFO is opened without waiting.
  explicit ByteInput(const std::string& path);
  ~ByteInput();
  ByteInput(const ByteInput&) = delete;
  ByteInput& operator=(const ByteInput&) = delete;

  // Fills `bytes` as far as the input goes; less where it ended or the program was told to stop. Throws
  // std::system_error where reading fails.
  std::size_t read(std::span<std::uint8_t> bytes);

 private:
  bool wait() const;

  int descriptor_;
  bool owned_;
};

}  // namespace ocisac::apps
