// Bytes of a file, a FIFO or standard input; signals end the wait.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace ocisac::apps {

// Throws std::invalid_argument for the file that standard output was redirected to.
void require_no_output(const char* option, const std::string& path, bool is_standard_input = false);

class ByteInput {
 public:
  // "-": standard input. Throws std::invalid_argument where the file cannot be opened. A FIFO is opened without
  // waiting.
  explicit ByteInput(const std::string& path);
  ~ByteInput();
  ByteInput(const ByteInput&) = delete;
  ByteInput& operator=(const ByteInput&) = delete;

  // Bytes from here to the end; absent where the input is no file.
  [[nodiscard]] std::optional<std::size_t> remaining() const;

  // Fills `bytes`; fewer at the end of the input or on a stop signal. Throws std::system_error where reading fails.
  std::size_t read(std::span<std::uint8_t> bytes);

 private:
  bool wait() const;

  int descriptor_;
  bool owned_;
};

}  // namespace ocisac::apps
